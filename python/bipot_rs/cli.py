"""The command `bipot`: arguments to scene to files.

Exit status: 0 solved, 1 no answer exists, 2 bad input, 3 not converged,
130 interrupted, 143 likewise by SIGTERM. Everything heavy is imported by the command
that needs it.
"""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

from bipot_rs.extras import missing
from bipot_rs.interrupts import Interrupts
from bipot_rs.job import BAD_INPUT, ENOUGH, INTERRUPTED, Job, complain

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
            # The lines of `fclib` are its files, and there is none to tell of.
            as_json = "--json" in arguments and arguments[0] != "fclib"
            job = Job(None, as_json=as_json)
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
                return job.end(BAD_INPUT, error.format_message())
            except OSError as error:
                return _output_gone(error)
            except SystemExit:
                # How libraries leave when the reader has gone (`| head`), with 1, which
                # here says that no answer exists.
                return BAD_INPUT
            except (KeyboardInterrupt, typer.Abort):
                pass
            if interrupts.came is not None and not interrupts.told:
                return job.end(interrupts.status, "interrupted")
            return status


app = _App(
    help="Frictional contact, exact on the mesh: from a scene to certified tractions.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


@app.command()
def run(
    context: typer.Context,
    scene: Annotated[
        str, typer.Argument(metavar="SCENE", help="A shipped name or a TOML file.")
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
    job = Job(scene, as_json=json, interrupts=context.obj)
    folder = Path("out") / Path(scene).stem if out is None else out
    status = job.run(
        settings or [],
        folder,
        method,
        _tol(tol),
        plot=plot,
        fclib=export,
        resume=resume,
        error=error,
    )
    raise typer.Exit(status)


@app.command()
def fclib(
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
    from bipot_rs import fclib_job

    raise typer.Exit(fclib_job.run(files, method, tol, max_seconds, as_json=json))


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
        Path | None, typer.Option(help="Table: node, fx, fy[, fz][, step].")
    ] = None,
    fixed: Annotated[
        Path | None,
        typer.Option(help="Table: node, ux, uy[, uz][, step], blank where free."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder of the results; out/STIFFNESS if not given."),
    ] = None,
    method: Annotated[str, typer.Option(help="Contact solver.")] = "auto",
    tol: Annotated[float, typer.Option(help="Residual to reach.")] = 1e-10,
    json: Annotated[
        bool, typer.Option("--json", help="One JSON object a line on standard output.")
    ] = False,
) -> None:
    """Solve contacts on a stiffness that another program has written.

    Degrees of freedom may be given instead of nodes: dof_x, dof_y[, dof_z], counted
    from 0, in the contacts, dof and force or value in the other tables. Writes
    reactions.csv, displacements.csv, steps.csv, result.h5, and with nodes result.pvd.
    """
    from bipot_rs import stiffness_job

    folder = Path("out") / stiffness.stem if out is None else out
    files = {
        "stiffness": stiffness,
        "contacts": contacts,
        "nodes": nodes,
        "load": load,
        "fixed": fixed,
    }
    status = stiffness_job.run(files, folder, method, tol, context.obj, as_json=json)
    raise typer.Exit(status)


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
        str | None, typer.Argument(help="Print the TOML of this scene.")
    ] = None,
) -> None:
    """List the shipped scenes, or print one."""
    from bipot_rs.shipped import SceneError, shipped, text

    try:
        typer.echo("\n".join(shipped()) if name is None else text(name).rstrip())
    except SceneError as error:
        complain(str(error))
        raise typer.Exit(BAD_INPUT) from None
