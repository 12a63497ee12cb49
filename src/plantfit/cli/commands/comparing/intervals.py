"""`plantfit intervals`: intervals of a study's parameters by several kinds, side by side."""

from pathlib import Path
from typing import Annotated

import typer

from plantfit.study.store.addresses import STORE, VARIABLE


def intervals(
    given: Annotated[str, typer.Argument(help="The study file (TOML), or the number or name of a stored study.")],
    kinds: Annotated[
        str, typer.Option("--kinds", help="Which, with commas: covariance, profile, bootstrap, posterior.")
    ] = "covariance,profile,bootstrap",
    posterior: Annotated[bool, typer.Option("--posterior", help="The posterior too, by NUTS; needs plantfit[posterior].")] = False,
    only: Annotated[str | None, typer.Option("--only", help="These parameters, as in tau,K; all if left out.")] = None,
    level: Annotated[str, typer.Option("--level", help="As in 95% or 0.95.")] = "95%",
    replicates: Annotated[int, typer.Option("--replicates", help="Refits of the bootstrap.")] = 400,
    chains: Annotated[int, typer.Option("--chains", help="Chains of the posterior.")] = 4,
    draws: Annotated[int, typer.Option("--draws", help="Draws of each chain.")] = 1000,
    prior: Annotated[
        list[str] | None, typer.Option("--prior", help="Known beforehand, for the posterior: 'tau=138 +- 5 s' (repeat).")
    ] = None,
    seed: Annotated[int, typer.Option("--seed", help="Same seed, same numbers.")] = 1,
    out: Annotated[str | None, typer.Option("--out", "-o", help="Where the HTML page goes; NAME-intervals.html if left out.")] = None,
    save_draws: Annotated[str | None, typer.Option("--save-draws", help="Also write the posterior's draws, as netCDF.")] = None,
    store: Annotated[str, typer.Option("--store", envvar=VARIABLE, help="Study database.")] = STORE,
    workers: Annotated[str | None, typer.Option("--workers", help="Worker processes, if the study has to be fitted first.")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print one JSON value, nothing else, on standard output.")] = False,
) -> None:
    """Intervals by covariance, profile likelihood, bootstrap and posterior, side by side, and where they disagree."""
    from plantfit.cli.arguments.file_names import file_name
    from plantfit.cli.arguments.quantities import fraction, texts_by_name
    from plantfit.cli.commands.comparing.fitted import answers_of, one_given
    from plantfit.cli.terminal.out import out as screen
    from plantfit.cli.terminal.out import print_json, said_line, verdict
    from plantfit.cli.terminal.working import worker_count
    from plantfit.errors import SpecError, StoreError
    from plantfit.report.html import check_place

    worker_count(workers, None)
    wanted = [k.strip() for k in kinds.split(",") if k.strip()]
    if (posterior or prior or save_draws) and "posterior" not in wanted:
        wanted.append("posterior")
    share = fraction("--level", level)
    priors = texts_by_name("--prior", prior or [])
    if save_draws:
        from plantfit.trust.intervals.kinds.inference_data import need_h5netcdf

        need_h5netcdf()
    if save_draws and (Path(save_draws).exists() or not Path(save_draws).absolute().parent.is_dir()):
        what = "is there already" if Path(save_draws).exists() else "cannot be written, because its folder does not exist"
        raise StoreError(f"{save_draws} {what}; give another place with --save-draws.")
    opened, one = one_given(given, store)
    to = Path(out or file_name(f"{one.ready.study.name}-intervals", "html"))
    check_place(to)
    from plantfit.intervals_compared import check_wishes, compare_intervals
    from plantfit.trust.intervals.kinds.priors import normal_priors

    names = [n.strip() for n in only.split(",") if n.strip()] if only else []
    check_wishes(wanted, share, replicates, chains, draws)
    normal_priors(one.ready.prepared.problem.space, priors)  # a slip is told before anything is fitted
    unknown = [n for n in names if n not in one.ready.prepared.problem.space.names]
    if unknown:
        raise SpecError(f"There is no free parameter {unknown[0]!r}; there are {', '.join(one.ready.prepared.problem.space.names)}.")
    answers, numbers = answers_of(opened, [one], workers, json)
    with said_line(json) as say:
        found = compare_intervals(
            answers[given], kinds=wanted, parameters=names, level=share, replicates=replicates, chains=chains, draws=draws, priors=priors,
            seed=seed, progress=say,
        )  # fmt: skip
    written = {"report": str(found.report(to))}
    if save_draws and found.draws is not None:
        written["draws"] = str(found.save_draws(save_draws))
    if json:
        return print_json(found.typed.printed(study=numbers[given], written=written))
    verdict(found.record)
    screen.print("\n" + found.table(), markup=False)
    screen.print(f"\nReport: {', '.join(written.values())}", markup=False)


__all__ = ["intervals"]
