"""The command `bipot`: its arguments, its help texts, and errors in the arguments.

Exit status: 0 solved, 1 no answer exists, 2 bad input, 3 not converged, 70 internal
error, 130 interrupted, 143 interrupted by SIGTERM. Every error ends in one message and,
with --json, in one line. A command imports large libraries when it needs them.
"""

from __future__ import annotations

import copy
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

from bipot_rs._lib.optional import missing
from bipot_rs.cli import completion, run_arguments
from bipot_rs.cli.entry import call
from bipot_rs.cli.exit_codes import BAD_INPUT, NO_ANSWER, SOLVED, Ended
from bipot_rs.cli.interrupts import Interrupts
from bipot_rs.cli.progress import complain, line
from bipot_rs.cli.runner import MISTAKES, outcome

try:
    import typer
    from typer.exceptions import TyperException
except ModuleNotFoundError as error:
    raise missing(error, "commands", "typer", "cli") from None


class _App(typer.Typer):
    """Typer, with one message for a wrong argument and the last line of --json."""

    def __call__(self, *args: Any, **_: Any) -> Any:
        arguments = [str(a) for a in (args[0] if args else sys.argv[1:])]
        # Without arguments this is the console command, and the process ends after it.
        return call(arguments, last=not args, by_typer=lambda: by_typer)

    def with_one(self, arguments: list[str]) -> _App:
        """Copy of this app with the command alone whose name comes first, if one does.

        Typer evaluates the annotations of all commands, in a tenth of the time of a small
        run.
        """
        only = copy.copy(self)
        only.registered_commands = [
            one
            for one in self.registered_commands
            if one.callback is not None and one.callback.__name__ in arguments[:1]
        ]
        return only if only.registered_commands else self


def _keys_like(ctx: typer.Context, incomplete: str) -> list[str]:
    """Keys of ``--set`` for shell completion, of the scene that is named before it."""
    given = ctx.params.get("scene") or ctx.params.get("names")
    # While the value of the last option is missing, the words before it are not sorted.
    named = [given] if isinstance(given, str) else [*(given or ()), *ctx.args]
    scene = next((word for word in named if not word.startswith("-")), None)
    return completion.keys(scene, incomplete)


def _helpful(message: str, arguments: list[str]) -> str:
    """Typer's message, with advice where there is some."""
    if message.startswith("No such command") and "Did you mean" not in message:
        from bipot_rs.scene.library import shipped

        name = arguments[0] if arguments else ""
        if Path(f"{name}.toml").is_file():
            name += ".toml"
        if name in shipped() or name.endswith(".toml"):
            return f"{message} To solve a scene: bipot run {name}"
        return f"{message} bipot --help lists the commands."
    if message.startswith("Missing ") and arguments:
        return f"{message} bipot {arguments[0]} --help lists the arguments."
    if message.startswith("Got unexpected extra argument") and "--set" in arguments:
        return f"{message}: --set takes KEY=VALUE in one piece, without spaces"
    return message


app = _App(
    help="Solve contact problems with Coulomb friction: scenes, matrices, FCLIB files.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


def by_typer(arguments: Sequence[str], interrupts: Interrupts) -> int:
    """Read the arguments and carry out their command; returns the exit status.

    Raises
    ------
    Ended
        An argument is wrong.
    """
    words = list(arguments)
    try:
        # typer turns an interrupt into an exit status, without a message.
        status: Any = typer.main.get_command(app.with_one(words)).main(
            words, prog_name="bipot", standalone_mode=False, obj=interrupts
        )
    except TyperException as error:
        raise Ended(BAD_INPUT, _helpful(error.format_message(), words)) from error
    except typer.Abort as error:
        raise KeyboardInterrupt from error
    return int(status or SOLVED)


def _version(asked: bool) -> None:
    if asked:
        import bipot_rs._core as _core

        typer.echo(f"bipot-rs {_core.version}")
        raise typer.Exit


_Scene = Annotated[
    str,
    typer.Argument(
        metavar="SCENE",
        help="Name of a shipped scene, or a TOML file.",
        autocompletion=completion.scenes,
    ),
]
_Json = Annotated[bool, typer.Option("--json", help="Print JSON, one object per line.")]
_Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Change a key, as in --set mesh.n=24.",
        autocompletion=_keys_like,
    ),
]
_Method = Annotated[
    str, typer.Option(help="Contact solver.", autocompletion=completion.methods)
]


class Engine(StrEnum):
    """What solves the linear systems: `ContactProblem`."""

    AUTO = "auto"
    DIRECT = "direct"
    ITERATIVE = "iterative"


class SceneEngine(StrEnum):
    """Engines of a scene; ``petsc`` runs on several processes."""

    AUTO = "auto"
    DIRECT = "direct"
    ITERATIVE = "iterative"
    PETSC = "petsc"


_OtherMethod = Annotated[
    str | None,
    typer.Option(
        help="Contact solver, instead of the scene's.",
        autocompletion=completion.methods,
    ),
]
_Tol = Annotated[float, typer.Option(help="Residual to reach.")]


@app.callback()
def _before(
    *,
    version: Annotated[
        bool,
        typer.Option(
            "--version",
            callback=_version,
            is_eager=True,
            help="Print the version. In Python, bp.show_versions() also prints libraries.",
        ),
    ] = False,
) -> None:
    """Options before the name of a command."""


@app.command()
def run(
    context: typer.Context,
    scene: _Scene,
    settings: _Settings = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the results. Default: out/SCENE.")
    ] = None,
    method: _OtherMethod = None,
    engine: Annotated[
        SceneEngine | None,
        typer.Option(
            help="Engine, instead of the scene's: see 'A large model'. With mpirun -n N "
            "before the command, 'petsc' uses N processes: see 'On a cluster'."
        ),
    ] = None,
    tol: Annotated[
        str | None,
        typer.Option(
            metavar="T",
            help="Residual to reach, instead of the scene's. With 'discretisation': a "
            "tenth of the discretisation error (P1 meshes only).",
        ),
    ] = None,
    json: _Json = False,
    plot: Annotated[
        bool,
        typer.Option(
            "--plot", help="Also write tractions.png and, with --error, error.png."
        ),
    ] = False,
    export: Annotated[
        bool,
        typer.Option(
            "--fclib",
            help="Also write each load step as an FCLIB file, problem-0000.hdf5.",
        ),
    ] = False,
    error: Annotated[
        bool,
        typer.Option(
            "--error",
            help="Estimate the discretisation error. Needs --set mesh.element=P1.",
        ),
    ] = False,
    resume: Annotated[
        bool,
        typer.Option(
            "--resume", help="Continue this run from its incomplete result.h5."
        ),
    ] = False,
) -> None:
    """Solve a scene. Writes steps.csv, result.h5, and files for ParaView.

    result.pvd holds the bodies, contact.pvd the contacts.

    Ctrl-C stops it; the load steps solved so far are written.
    """
    status = run_arguments.run(
        scene=scene,
        settings=settings,
        out=out,
        method=method,
        engine=None if engine is None else engine.value,
        tol=tol,
        json=json,
        plot=plot,
        export=export,
        error=error,
        resume=resume,
        interrupts=context.obj,
    )
    raise typer.Exit(status)


@app.command()
def fclib(
    context: typer.Context,
    files: Annotated[
        list[str], typer.Argument(metavar="FILE...", help="FCLIB files (HDF5).")
    ],
    method: _Method = "auto",
    tol: _Tol = 1e-10,
    max_seconds: Annotated[
        float | None,
        typer.Option(help="Time limit of the solver for each file, in seconds."),
    ] = None,
    json: _Json = False,
) -> None:
    """Solve files of the FCLIB collection. Prints one line per file and a summary.

    The line also shows the asymmetry of the matrix if it is above 1e-11.
    """
    from bipot_rs.cli.commands.fclib import Request, Solve

    request = Request(files, method, tol, max_seconds)
    raise typer.Exit(Solve(request, as_json=json, interrupts=context.obj).run())


@app.command()
def solve(
    context: typer.Context,
    stiffness: Annotated[
        Path,
        typer.Option(
            help="Stiffness: a Matrix Market file, or lines node, component, node, "
            "component, value as Abaqus writes them."
        ),
    ],
    contacts: Annotated[
        Path,
        typer.Option(
            help="CSV table with columns node, nx, ny[, nz], mu[, other, gap, area]."
        ),
    ],
    nodes: Annotated[
        Path | None,
        typer.Option(
            help="CSV table with columns node, x, y[, z], or a file with *NODE lines."
        ),
    ] = None,
    load: Annotated[
        Path | None,
        typer.Option(help="CSV table with columns node, fx, fy[, fz][, step]."),
    ] = None,
    fixed: Annotated[
        Path | None,
        typer.Option(
            help="CSV table with columns node, ux, uy[, uz][, step]; empty where free."
        ),
    ] = None,
    order: Annotated[
        str | None,
        typer.Option(
            metavar="node|component",
            help="Order of the degrees of freedom in a Matrix Market file. node "
            "(default): d * row + component, with the rows of --nodes. component: all "
            "u_x, then all u_y. The order is checked with rigid motions.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for the results. Default: out/STIFFNESS."),
    ] = None,
    stiffness_rtol: Annotated[
        float | None,
        typer.Option(
            help="Relative error of the entries of the stiffness: 1e-8 for eight digits. "
            "Rigid motions are restored. Needs --nodes."
        ),
    ] = None,
    method: _Method = "auto",
    engine: Annotated[
        Engine, typer.Option(help="Engine; 'iterative' needs --nodes.")
    ] = Engine.AUTO,
    tol: _Tol = 1e-10,
    json: _Json = False,
) -> None:
    """Solve a contact problem with a stiffness matrix of another program.

    Tables may name degrees of freedom instead of nodes: columns dof_x, dof_y[, dof_z] in
    --contacts, dof and force in --load, dof and value in --fixed. Steps and degrees of
    freedom count from 0. To name nodes of a Matrix Market file, give --nodes and, if
    needed, --order. Writes reactions.csv, displacements.csv, steps.csv, result.h5 and,
    with --nodes, contact.pvd and result.pvd for ParaView.
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
        engine=engine.value,
    )
    raise typer.Exit(Solve(request, as_json=json, interrupts=context.obj).run())


@app.command()
def scenes(
    name: Annotated[
        str | None,
        typer.Argument(
            help="Print the TOML of this scene.", autocompletion=completion.scenes
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


@app.command()
def new(
    name: Annotated[
        str, typer.Argument(help="Name of the new file; .toml is added.")
    ] = "scene",
    template: Annotated[
        str,
        typer.Option(
            help="Kind of scene: block, mesh, mortar, obstacle or two_bodies.",
            autocompletion=completion.templates,
        ),
    ] = "block",
) -> None:
    """Write a commented scene to start from. An existing file is not overwritten."""
    from bipot_rs.cli.commands.new import write

    with _errors_reported():
        path, *others = write(name, template)
        written = " and ".join(map(str, [path, *others]))
        typer.echo(f"{written}: bipot check {path}, bipot run {path}")


@app.command()
def check(scene: _Scene, settings: _Settings = None, json: _Json = False) -> None:
    """Check a scene: report its mistakes, its size, memory and time. Does not solve."""
    from bipot_rs.cli.commands.check import check as check_scene

    with _errors_reported(as_json=json, scene=scene):
        found = check_scene(scene, settings or []) | {"scene": scene}
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
            help="A result, scene, mesh, matrix, FCLIB or ParaView file (.pvd, .vtu); a "
            "folder of a run or sweep.",
        ),
    ],
    json: _Json = False,
) -> None:
    """Summarise a file or a folder in some ten lines."""
    from bipot_rs.cli.commands.info import info as summarise

    with _errors_reported(as_json=json, file=file):
        _say(summarise(file), as_json=json)


@app.command()
def plot(
    result: Annotated[
        str,
        typer.Argument(
            metavar="RESULT",
            help="The folder of a run, or its result.h5; with --x and --y, the folder of a "
            "sweep.",
        ),
    ],
    kind: Annotated[
        str,
        typer.Option(
            help="Picture to draw: tractions, slip, status_map, resultants, "
            "status_shares, force_displacement, dissipation, deformed; of a run with wear "
            "also wear. In three dimensions "
            "also pressure_3d, shear_3d, gap_3d, slip_3d, status_3d; for plane surfaces "
            "pressure_map, shear_map, gap_map.",
            autocompletion=completion.kinds,
        ),
    ] = "tractions",
    out: Annotated[
        Path | None,
        typer.Option(
            help="File to write. Default: RESULT/KIND.png. NAME.gif is an animation over "
            "the load steps."
        ),
    ] = None,
    contact: Annotated[
        str | None,
        typer.Option(
            metavar="BODY.SURFACE", help="Contact surface to draw. Default: all."
        ),
    ] = None,
    along: Annotated[
        str | None,
        typer.Option(
            metavar="x|y|z|arc",
            help="Horizontal axis of a line: a coordinate, or arc for its arc length.",
        ),
    ] = None,
    step: Annotated[
        int | None,
        typer.Option(
            metavar="K", help="Load step to draw, counted from 1. Default: the last."
        ),
    ] = None,
    near: Annotated[
        float | None,
        typer.Option(
            metavar="F",
            help="For deformed: only the surroundings of the contacts, up to F times their "
            "extent.",
        ),
    ] = None,
    scale: Annotated[
        float | None,
        typer.Option(
            metavar="F", help="For deformed: the factor of the displacements."
        ),
    ] = None,
    scene: Annotated[
        str | None,
        typer.Option(
            help="Scene of the result, for deformed and the _3d pictures. Default: the "
            "scene named in the result."
        ),
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Keys that were set for the run.",
            autocompletion=_keys_like,
        ),
    ] = None,
    x: Annotated[
        str | None,
        typer.Option(
            "--x",
            metavar="COLUMN",
            help="Column of the table of a sweep on the horizontal axis. contact.0.mu may "
            "be shortened to mu.",
        ),
    ] = None,
    y: Annotated[
        str | None,
        typer.Option(
            "--y",
            metavar="COLUMN",
            help="Column on the vertical axis. 'max_pressure of body.surface' may be "
            "shortened to max_pressure.",
        ),
    ] = None,
) -> None:
    """Draw a picture of a result or of a sweep. Does not solve again."""
    from bipot_rs.cli.commands.plot import draw
    from bipot_rs.cli.commands.plot_study import draw as draw_study
    from bipot_rs.cli.commands.plot_study import is_study

    with _errors_reported():
        if is_study(Path(result)):
            others = {
                "--kind": None if kind == "tractions" else kind,
                "--contact": contact,
                "--along": along,
                "--step": step,
                "--near": near,
                "--scale": scale,
                "--scene": scene,
                "--set": settings,
            }
            for name, value in others.items():
                if value is not None:
                    raise ValueError(
                        f"{name} cannot be used with the folder of a sweep"
                    )
            made, said = draw_study(Path(result), x, y, out)
            complain(said)
            typer.echo(made)
            return
        if x is not None or y is not None:
            raise ValueError(
                f"--x and --y need the folder of a sweep, but {result} is not"
            )
        made = draw(
            result,
            kind,
            out,
            contact=contact,
            along=along,
            step=step,
            near=near,
            scale=scale,
            scene=scene,
            settings=settings or (),
        )
        typer.echo(made)


@app.command()
def sweep(
    context: typer.Context,
    names: Annotated[
        list[str],
        typer.Argument(
            metavar="SCENE",
            help="Name of a shipped scene, or a TOML file. With --join: folders of parts, "
            "or folders that hold them.",
            autocompletion=completion.scenes,
        ),
    ],
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=V1,V2,…",
            help="Values of a key: contact.0.mu=0.1,0.3.",
            autocompletion=_keys_like,
        ),
    ] = None,
    ranges: Annotated[
        list[str] | None,
        typer.Option(
            "--range",
            metavar="KEY=FROM:TO:COUNT",
            help="COUNT equally spaced values: 0.1:0.5:3 is 0.1, 0.3, 0.5.",
            autocompletion=_keys_like,
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder for sweep.csv. Default: out/SCENE-sweep; with --join, the folder "
            "that the parts are in."
        ),
    ] = None,
    method: _OtherMethod = None,
    tol: Annotated[
        float | None, typer.Option(help="Residual to reach, instead of the scene's.")
    ] = None,
    jobs: Annotated[
        int | None,
        typer.Option(
            min=1, help="Processes with one thread each. Default: one per core."
        ),
    ] = None,
    part: Annotated[
        str | None,
        typer.Option(
            metavar="I/N",
            help="Solve part I of N only, into the folder part-I-of-N of --out.",
        ),
    ] = None,
    join: Annotated[
        bool,
        typer.Option(
            "--join", help="Join the tables and results of parts; no solving."
        ),
    ] = False,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Solve the rows on the workers of this dask.distributed scheduler: "
            "tcp://HOST:8786, or its scheduler file.",
        ),
    ] = None,
    results: Annotated[
        bool,
        typer.Option(
            "--results",
            help="Write rows/NNNN/result.h5 of every row, not only of rows that fail.",
        ),
    ] = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Keep finished rows and solve the others.")
    ] = False,
    json: _Json = False,
) -> None:
    """Solve a scene for all combinations of settings, in parallel. Writes sweep.csv.

    A row that fails has its message in the table, and the load steps before the failure
    in rows/NNNN/result.h5. Ctrl-C keeps the finished rows.
    """
    others = {
        "--set": settings,
        "--range": ranges,
        "--method": method,
        "--tol": tol,
        "--jobs": jobs,
        "--part": part,
        "--scheduler": scheduler,
        "--results": results,
        "--resume": resume,
    }
    fields = {"join": names} if join else {"scene": names[0]}
    with _errors_reported(as_json=json, interrupts=context.obj, **fields):
        if join:
            from bipot_rs.cli.commands.sweep_join import run as join_all

            for name, value in others.items():
                if value:
                    raise ValueError(f"{name} cannot be used with --join")
            status = join_all([Path(one) for one in names], out, as_json=json)
            raise typer.Exit(status)
        from bipot_rs.cli.commands.sweep import Request as Study
        from bipot_rs.cli.commands.sweep import run as solve_all
        from bipot_rs.cli.study.part import part as read_part

        if len(names) > 1:
            raise ValueError(
                f"SCENE is given {len(names)} times, expected once: {', '.join(names)}"
            )
        folder = Path("out") / f"{Path(names[0]).stem}-sweep" if out is None else out
        request = Study(
            scene=names[0],
            settings=settings or [],
            ranges=ranges or [],
            folder=folder,
            method=method,
            tol=tol,
            part=None if part is None else read_part(part),
            results=results,
            jobs=jobs,
            scheduler=scheduler,
            resume=resume,
            as_json=json,
        )
        raise typer.Exit(solve_all(request))


@app.command()
def schema() -> None:
    """Print the JSON schema of scene files, with which an editor can check them."""
    from json import dumps

    from bipot_rs.cli.commands.schema import schema as scene_schema

    typer.echo(dumps(scene_schema(), indent=2))


def _say(found: dict[str, Any], *, as_json: bool) -> None:
    lines = found.pop("lines")
    if as_json:
        line(**found)
    else:
        typer.echo("\n".join(lines))


@contextmanager
def _errors_reported(
    *, as_json: bool = False, interrupts: Interrupts | None = None, **fields: Any
) -> Iterator[None]:
    """Turn an exception into a message and an exit status."""
    from bipot_rs.contact.errors import BipotError

    try:
        yield
        return
    except BrokenPipeError:
        raise
    except KeyboardInterrupt:
        if interrupts is None:
            raise
        message = "interrupted; --resume solves the remaining rows"
        status = interrupts.status
        interrupts.reported = True
    except (BipotError, *MISTAKES) as error:
        status, message = outcome(error)
    if as_json:
        line(**fields, ok=False, message=message)
    else:
        complain(message)
    raise typer.Exit(status)
