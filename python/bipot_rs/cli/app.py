"""The command `bipot`: arguments to scene to files.

Exit status: 0 solved, 1 no answer exists, 2 bad input, 3 not converged, 70 a fault of the
program, 130 interrupted, 143 likewise by SIGTERM. Every exit has a sentence, and with
--json a line. Everything heavy is imported by the command that needs it.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Annotated, Any

from bipot_rs._lib.optional import missing
from bipot_rs.cli.commands.run import ENOUGH, Job, Request
from bipot_rs.cli.exit_codes import (
    BAD_INPUT,
    FAULT,
    INTERRUPTED,
    NO_ANSWER,
    SOLVED,
)
from bipot_rs.cli.interrupts import Interrupts
from bipot_rs.cli.progress import complain, line
from bipot_rs.cli.runner import MISTAKES, outcome

try:
    import typer
    from typer.exceptions import TyperException
except ModuleNotFoundError as error:
    raise missing(error, "commands", "typer", "cli") from None


class _App(typer.Typer):
    """Typer, with one sentence for a wrong argument and the last line of --json."""

    def __call__(self, *args: Any, **_: Any) -> Any:
        arguments = [str(a) for a in (args[0] if args else sys.argv[1:])]
        _open_streams()
        # Called without arguments, the command is all that its process does.
        with Interrupts(last=not args) as interrupts:

            def end(status: int, message: str) -> int:
                if "--json" in arguments and arguments[0] != "run":
                    interrupts.told = True
                    line(command=arguments[0], ok=False, success=False, message=message)
                    if arguments[0] == "fclib":
                        # On standard output it prints one line a file; an error of the
                        # command itself goes to standard error.
                        complain(message)
                    return status
                job = Job(Request(), as_json="--json" in arguments)
                return job.end(status, message)

            status: Any = INTERRUPTED
            if arguments[:1] == ["run"]:
                # It says itself from where on it can be stopped.
                interrupts.hold()
            try:
                # Of an interrupt typer makes the status, without a word.
                status = typer.main.get_command(self).main(
                    arguments, prog_name="bipot", standalone_mode=False, obj=interrupts
                )
            except TyperException as error:
                return end(BAD_INPUT, _helpful(error.format_message(), arguments))
            except OSError as error:
                return _output_gone(error)
            except SystemExit as left:
                # With 0 a shell has what it completes by; with 1 is how libraries leave
                # when the reader has gone (`| head`), which here says that no answer
                # exists.
                return BAD_INPUT if left.code else SOLVED
            except (KeyboardInterrupt, typer.Abort):
                pass
            except Exception as error:
                if os.environ.get("BIPOT_TRACEBACK"):
                    raise
                return end(FAULT, _fault(error))
            if interrupts.came is not None and not interrupts.told:
                return end(interrupts.status, "interrupted")
            return status


def _fault(error: Exception) -> str:
    """The message for an exception that no command expects: a fault of the program."""
    said = " ".join(str(error).split())
    return (
        f"this is a fault of bipot, {type(error).__name__}{': ' if said else ''}{said}; "
        "please report it with what BIPOT_TRACEBACK=1 shows"
    )


def _scenes_like(incomplete: str) -> list[str]:
    """Shipped scenes for a shell to complete; it knows files itself."""
    from bipot_rs.scene.library import shipped

    return [name for name in shipped() if name.startswith(incomplete)]


def _helpful(message: str, arguments: list[str]) -> str:
    """Typer's sentence, with what was meant where that is known."""
    if message.startswith("No such command") and "Did you mean" not in message:
        from bipot_rs.scene.library import shipped

        name = arguments[0] if arguments else ""
        if Path(f"{name}.toml").is_file():
            name += ".toml"
        if name in shipped() or name.endswith(".toml"):
            return f"{message} To solve a scene: bipot run {name}"
        return f"{message} bipot --help lists the commands."
    if message.startswith("Missing ") and arguments:
        return f"{message} bipot {arguments[0]} --help tells what it takes."
    if message.startswith("Got unexpected extra argument") and "--set" in arguments:
        return f"{message}: --set takes KEY=VALUE in one piece, without spaces"
    return message


app = _App(
    help="Frictional contact, exact on the mesh: from a scene to certified tractions.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


def _version(asked: bool) -> None:
    if asked:
        from bipot_rs import _core

        typer.echo(f"bipot-rs {_core.version}")
        raise typer.Exit


@app.callback()
def _before(
    *,
    version: Annotated[
        bool,
        typer.Option(
            "--version",
            callback=_version,
            is_eager=True,
            help="Print the version; bp.show_versions() in Python tells more.",
        ),
    ] = False,
) -> None:
    """What the command takes before the name of another."""


@app.command()
def run(
    context: typer.Context,
    scene: Annotated[
        str,
        typer.Argument(
            metavar="SCENE",
            help="A shipped name or a TOML file.",
            autocompletion=_scenes_like,
        ),
    ],
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="As in --set mesh.n=24."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder of the results; out/SCENE if not given.")
    ] = None,
    method: Annotated[
        str | None, typer.Option(help="Contact solver, instead of the scene's.")
    ] = None,
    tol: Annotated[
        str | None,
        typer.Option(
            metavar="T",
            help="Residual to reach, instead of the scene's; or discretisation: a tenth "
            "of the error of a P1 mesh.",
        ),
    ] = None,
    json: Annotated[
        bool, typer.Option("--json", help="One JSON object a line on standard output.")
    ] = False,
    plot: Annotated[
        bool,
        typer.Option(
            "--plot", help="Write tractions.png as well; with --error, error.png."
        ),
    ] = False,
    export: Annotated[
        bool,
        typer.Option("--fclib", help="Write problem-0000.hdf5, … for other solvers."),
    ] = False,
    error: Annotated[
        bool,
        typer.Option(
            "--error",
            help="Tell the discretisation error; needs --set mesh.element=P1.",
        ),
    ] = False,
    resume: Annotated[
        bool,
        typer.Option(
            "--resume", help="Go on from an incomplete result.h5 of this run."
        ),
    ] = False,
) -> None:
    """Solve a scene: a table of load steps, result.h5, result.pvd for ParaView.

    Ctrl-C ends it with the load steps that are complete.
    """
    request = Request(
        scene=scene,
        settings=settings or [],
        folder=Path("out") / Path(scene).stem if out is None else out,
        method=method,
        tol=_tol(tol),
        plot=plot,
        fclib=export,
        resume=resume,
        error=error,
    )
    raise typer.Exit(Job(request, as_json=json, interrupts=context.obj).run())


@app.command()
def fclib(
    context: typer.Context,
    files: Annotated[list[str], typer.Argument(metavar="FILE...", help="HDF5 files.")],
    method: Annotated[str, typer.Option(help="Contact solver.")] = "auto",
    tol: Annotated[float, typer.Option(help="Residual to reach.")] = 1e-10,
    max_seconds: Annotated[
        float | None, typer.Option(help="Limit of the solver, for each file.")
    ] = None,
    json: Annotated[
        bool, typer.Option("--json", help="One JSON object a line on standard output.")
    ] = False,
) -> None:
    """Solve problems of the FCLIB collection: a line a file, and a summary.

    The asymmetry of a matrix is told where it is more than rounding, beyond 1e-11.
    """
    from bipot_rs.cli.commands.fclib import Request, Solve

    request = Request(files, method, tol, max_seconds)
    raise typer.Exit(Solve(request, as_json=json, interrupts=context.obj).run())


@app.command()
def solve(
    context: typer.Context,
    stiffness: Annotated[
        Path,
        typer.Option(help="Matrix Market, or node, component, … as Abaqus writes it."),
    ],
    contacts: Annotated[
        Path, typer.Option(help="Table: node, nx, ny[, nz], mu[, other, gap, area].")
    ],
    nodes: Annotated[
        Path | None,
        typer.Option(help="Table: node, x, y[, z]; or a file with a *NODE listing."),
    ] = None,
    load: Annotated[
        Path | None, typer.Option(help="Table: node, fx, fy[, fz][, step from 0].")
    ] = None,
    fixed: Annotated[
        Path | None,
        typer.Option(
            help="Table: node, ux, uy[, uz][, step from 0], blank where free."
        ),
    ] = None,
    order: Annotated[
        str | None,
        typer.Option(
            metavar="node|component",
            help="Degrees of freedom of a Matrix Market file: node, d * row + component in "
            "the rows of --nodes (default), or component, all u_x, then all u_y. It is "
            "checked: rigid motions must leave nothing.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder of the results; out/STIFFNESS if not given."),
    ] = None,
    stiffness_rtol: Annotated[
        float | None,
        typer.Option(
            help="Relative error of the entries of the stiffness, 1e-8 for eight digits: "
            "rigid motions are restored; needs --nodes."
        ),
    ] = None,
    method: Annotated[str, typer.Option(help="Contact solver.")] = "auto",
    tol: Annotated[float, typer.Option(help="Residual to reach.")] = 1e-10,
    json: Annotated[
        bool, typer.Option("--json", help="One JSON object a line on standard output.")
    ] = False,
) -> None:
    """Solve contacts on a stiffness that another program has written.

    Degrees of freedom may be given instead of nodes: dof_x, dof_y[, dof_z], counted
    from 0, in the contacts, dof and force or value in the other tables. Of a Matrix Market
    file --nodes says which degree of freedom is which, in --order. Writes
    reactions.csv, displacements.csv, steps.csv, result.h5, and with nodes result.pvd.
    """
    from bipot_rs.cli.commands.solve import Request, Solve

    request = Request(
        stiffness=stiffness,
        contacts=contacts,
        nodes=nodes,
        load=load,
        fixed=fixed,
        order=order,
        folder=Path("out") / stiffness.stem if out is None else out,
        method=method,
        tol=tol,
        stiffness_rtol=stiffness_rtol,
    )
    raise typer.Exit(Solve(request, as_json=json, interrupts=context.obj).run())


def _tol(given: str | None) -> float | str | None:
    if given is None or given == ENOUGH:
        return given
    try:
        return float(given)
    except ValueError:
        raise typer.BadParameter(
            f"{given!r} is neither a number nor {ENOUGH}", param_hint="'--tol'"
        ) from None


def _open_streams() -> None:
    """Give what the caller has closed (`>&-`) a place to write to.

    The status still tells how it went. Else the next file that is opened would take
    the number of a standard stream, and what libraries print would go into it.
    """
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_WRONLY), "w"))


def _output_gone(error: OSError) -> int:
    """The disk behind `> file` is full: what is still buffered has no place to go."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    with suppress(OSError):
        complain(f"cannot write to standard output: {error}")
    return BAD_INPUT


@app.command()
def scenes(
    name: Annotated[
        str | None,
        typer.Argument(
            help="Print the TOML of this scene.", autocompletion=_scenes_like
        ),
    ] = None,
) -> None:
    """List the shipped scenes, or print one."""
    from bipot_rs.scene.library import SceneError, shipped, text

    try:
        typer.echo("\n".join(shipped()) if name is None else text(name).rstrip())
    except SceneError as error:
        complain(str(error))
        raise typer.Exit(BAD_INPUT) from None


_Scene = Annotated[
    str,
    typer.Argument(
        metavar="SCENE",
        help="A shipped name or a TOML file.",
        autocompletion=_scenes_like,
    ),
]
_Json = Annotated[
    bool, typer.Option("--json", help="One JSON object a line on standard output.")
]


@app.command()
def new(
    name: Annotated[str, typer.Argument(help="The file, .toml added.")] = "scene",
    template: Annotated[
        str,
        typer.Option(
            help="What to begin with: block, mesh, mortar, obstacle or two_bodies."
        ),
    ] = "block",
) -> None:
    """Write a commented scene that runs as it is; an existing file stays as it is."""
    from bipot_rs.cli.commands.new import write

    with _refusing():
        path, *beside = write(name, template)
        written = " and ".join(map(str, [path, *beside]))
        typer.echo(f"{written}: bipot check {path}, bipot run {path}")


@app.command()
def check(
    scene: _Scene,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="As in --set mesh.n=24."),
    ] = None,
    json: _Json = False,
) -> None:
    """Tell all mistakes of a scene, its sizes, memory and time, without solving."""
    from bipot_rs.cli.commands.check import check as of

    with _refusing(as_json=json, scene=scene):
        found = of(scene, settings or []) | {"scene": scene}
        floating = found.pop("floating")
        ended = {"ok": floating is None}
        if floating is not None:
            ended["message"] = floating
        _say(found | ended, as_json=json)
        if floating is not None:
            if not json:
                complain(floating)
            raise typer.Exit(NO_ANSWER)


@app.command()
def info(
    file: Annotated[
        str,
        typer.Argument(
            metavar="FILE",
            help="A result, the folder of a run or of a sweep, a mesh, a problem, a scene.",
        ),
    ],
    json: _Json = False,
) -> None:
    """Tell what is in a file or a folder, in some ten lines."""
    from bipot_rs.cli.commands.info import info as of

    with _refusing(as_json=json, file=file):
        _say(of(file), as_json=json)


@app.command()
def plot(
    result: Annotated[
        str,
        typer.Argument(metavar="RESULT", help="The folder of a run, or its result.h5."),
    ],
    kind: Annotated[
        str,
        typer.Option(
            help="Which picture: tractions, slip, status_map, resultants, status_shares, "
            "force_displacement, dissipation, deformed; of a plane surface in space also "
            "pressure_map, shear_map, gap_map, of any pressure_3d, shear_3d, gap_3d, "
            "slip_3d, status_3d."
        ),
    ] = "tractions",
    out: Annotated[
        Path | None, typer.Option(help="The file; RESULT/KIND.png if not given.")
    ] = None,
    contact: Annotated[
        str | None,
        typer.Option(
            metavar="BODY.SURFACE", help="The contact surface; all if not given."
        ),
    ] = None,
    along: Annotated[
        str | None,
        typer.Option(
            metavar="x|y|z|arc",
            help="What places along a line are: a coordinate, or the length of its arc.",
        ),
    ] = None,
    step: Annotated[
        int | None,
        typer.Option(
            metavar="K",
            help="The load step to draw, from 1 as in the table; the last if not given.",
        ),
    ] = None,
    scene: Annotated[
        str | None,
        typer.Option(
            help="Of deformed and the pictures in 3d: the scene, where the result does "
            "not lead to it."
        ),
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="What was set in --scene."),
    ] = None,
) -> None:
    """Draw a result that is there, without solving."""
    from bipot_rs.cli.commands.plot import draw

    with _refusing():
        made = draw(
            result,
            kind,
            out,
            contact=contact,
            along=along,
            step=step,
            scene=scene,
            settings=settings or (),
        )
        typer.echo(made)


@app.command()
def sweep(
    context: typer.Context,
    scene: _Scene,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="KEY=V1,V2,…", help="As in --set contact.0.mu=0.1,0.3."
        ),
    ] = None,
    ranges: Annotated[
        list[str] | None,
        typer.Option(
            "--range",
            metavar="KEY=FROM:TO:COUNT",
            help="COUNT values with both ends: 0.1:0.5:3 is 0.1, 0.3, 0.5.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder of sweep.csv; out/SCENE-sweep if not given."),
    ] = None,
    method: Annotated[
        str | None, typer.Option(help="Contact solver, instead of the scene's.")
    ] = None,
    tol: Annotated[
        float | None, typer.Option(help="Residual to reach, instead of the scene's.")
    ] = None,
    jobs: Annotated[
        int | None,
        typer.Option(min=1, help="Processes, of one thread each; a core each."),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Keep the rows that are done.")
    ] = False,
    json: _Json = False,
) -> None:
    """Solve a scene under all combinations of settings, in parallel, into one table.

    Rows that fail are told in it; Ctrl-C ends with the rows that are done.
    """
    from bipot_rs.cli.commands.sweep import run as solve_all

    folder = Path("out") / f"{Path(scene).stem}-sweep" if out is None else out
    with _refusing(as_json=json, scene=scene, interrupts=context.obj):
        status = solve_all(
            scene,
            settings or [],
            ranges or [],
            folder,
            method,
            tol,
            jobs=jobs,
            resume=resume,
            as_json=json,
        )
        raise typer.Exit(status)


@app.command()
def schema() -> None:
    """Print the JSON schema of scene files, for editors that check them."""
    from json import dumps

    from bipot_rs.cli.commands.schema import schema as of

    typer.echo(dumps(of(), indent=2))


def _say(found: dict[str, Any], *, as_json: bool) -> None:
    lines = found.pop("lines")
    if as_json:
        line(**found)
    else:
        typer.echo("\n".join(lines))


@contextmanager
def _refusing(
    *, as_json: bool = False, interrupts: Interrupts | None = None, **told: Any
) -> Iterator[None]:
    """Make bad input a sentence and a status; with --json the last line has both."""
    from bipot_rs.contact.errors import BipotError

    try:
        yield
        return
    except BrokenPipeError:
        raise
    except KeyboardInterrupt:
        if interrupts is None:
            raise
        message = "interrupted; --resume goes on with the rows that are left"
        status = interrupts.status
        interrupts.told = True
    except BipotError as error:
        status, message = outcome(error)
    except MISTAKES as error:
        status, message = outcome(error)
    if as_json:
        line(**told, ok=False, message=message)
    else:
        complain(message)
    raise typer.Exit(status)
