"""The command that closes a loop: ``regulate``."""

from __future__ import annotations

from pathlib import Path

import click

from ctlabs.cli.common import whole
from ctlabs.cli.work import deliver, folder_of, model_of, one_stdin, options, outside, seed_option


@click.command()
@options
@click.option("--design", metavar="MODEL2", help="Design for this model, and say what that costs if MODEL is the truth.")
@click.option("--horizon", metavar="T", type=float, help="Regulate for T seconds (steps of a discrete model) instead of for ever.")
@click.option("--dt", metavar="SECONDS", type=float, help="Another period of the regulator (default: the model's).")
@click.option("--delay", metavar="SECONDS", type=float, help="From a measurement to the moment at which its answer acts.")
@click.option("--kind", metavar="current|delayed", help="An input answers the measurement of its own instant, or that before.")
@click.option("--runs", metavar="N", callback=whole(1), help="Number of simulated runs (default: the model's).")
@seed_option()
@click.option("--steps", metavar="N", callback=whole(1), help="For how many steps the loop is followed (default: the model's).")
@click.option("--workers", metavar="N", callback=whole(1), help="Blocks of runs computed at a time (default: all cores).")
@click.option(
    "--export",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="The controller for other programs: FILE.npz (NumPy), FILE.mat (MATLAB) or FILE.h (C, with a function of one step).",
)
def regulate(
    model: str,
    design: str | None,
    horizon: float | None,
    dt: float | None,
    delay: float | None,
    kind: str | None,
    runs: int | None,
    seed: int | None,
    steps: int | None,
    workers: int | None,
    export: Path | None,
    pairs: tuple[str, ...],
    out: Path | None,
    as_json: bool,
) -> int:
    """Design the regulator of a plant, and say what its loop does and costs.

    MODEL is a model file with inputs (B) and a table [cost], a name of the gallery (`ctlabs models`) or - (standard input).
    [cost] says what is to be kept small: Qx, the weight of the states (or outputs), against Qu, the weight of the inputs. The
    report has the gains of the optimal regulator and of the filter in it, the poles, the cost on three routes and where it comes
    from, the standard deviations of states and inputs, the responses to steps and kicks, the margins, and many simulated runs.

    Weigh each quantity by one over the square of what is too much of it, look at the report, and change one weight at a time.

    \b
    ctlabs regulate double_integrator                    writes double_integrator/report.html, …
    ctlabs regulate cart_pendulum --set u_max=5          a stronger motor may push harder
    ctlabs regulate cart_pendulum --dt 0.1 --delay 0.02  a slower computer
    ctlabs regulate truth.toml --design simple.toml      what a wrong model costs, and whether it is stable
    ctlabs regulate double_integrator --horizon 5        gains scheduled over five seconds
    ctlabs regulate dc_motor --export motor.h            the controller in C
    """
    from ctlabs.studies import filtering, regulated, regulating

    one_stdin(model, design)
    told = {"horizon": horizon, "dt": dt, "delay": delay, "kind": kind}
    chosen = regulating.changed(model_of(model, pairs), **told)
    other = None
    if design is not None:
        other = model_of(design, ())
        own = told if other.cost is not None else {"dt": dt}  # one without [cost] is judged, and built, by that of MODEL
        other = regulating.changed(other, **own)
    folder = folder_of(model, out, design)
    if export is not None:
        filtering.exportable(export)
        outside("--export", export, folder)
    found = regulating.compute(chosen, design=other, runs=runs, seed=seed, steps=steps, workers=workers)
    code = deliver(regulated.report(found), folder, as_json, "gains", "cost", "budget", "sizes", "margins")
    if export is not None:
        click.echo(str(found.regulator.export(export)), err=as_json)
    return code
