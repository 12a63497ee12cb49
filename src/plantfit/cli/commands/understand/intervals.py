"""`plantfit intervals`: intervals of a study's parameters by several kinds, side by side."""

from collections.abc import Mapping, Sequence
from pathlib import Path


def intervals(
    given: str, kinds: str, posterior: bool, only: str | None, level: str, numbers: Mapping[str, int],
    prior: Sequence[str],
    out: str | None, save_draws: str | None, store: str, workers: str | None, json: bool,
) -> None:  # fmt: skip
    """Intervals by covariance, profile likelihood, bootstrap and posterior, side by side, and where they disagree."""
    from plantfit.cli.arguments.file_names import file_name
    from plantfit.cli.arguments.quantities import fraction, texts_by_name
    from plantfit.cli.commands.understand.fitted import answers_of, one_given
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
    priors = texts_by_name("--prior", prior)
    if save_draws:
        from plantfit.trust.intervals.kinds.inference_data import need_h5netcdf

        need_h5netcdf()
    if save_draws and (Path(save_draws).exists() or not Path(save_draws).absolute().parent.is_dir()):
        what = (
            "is there already" if Path(save_draws).exists() else "cannot be written, because its folder does not exist"
        )
        raise StoreError(f"{save_draws} {what}; give another place with --save-draws.")
    opened, one = one_given(given, store)
    to = Path(out or file_name(f"{one.ready.study.name}-intervals", "html"))
    check_place(to)
    from plantfit.intervals_compared import check_wishes, compare_intervals
    from plantfit.trust.intervals.kinds.priors import normal_priors

    names = [n.strip() for n in only.split(",") if n.strip()] if only else []
    check_wishes(wanted, share, numbers["replicates"], numbers["chains"], numbers["draws"])
    normal_priors(one.ready.prepared.problem.space, priors)  # a slip is told before anything is fitted
    unknown = [n for n in names if n not in one.ready.prepared.problem.space.names]
    if unknown:
        raise SpecError(
            f"There is no free parameter {unknown[0]!r}; there are {', '.join(one.ready.prepared.problem.space.names)}."
        )
    answers, stored = answers_of(opened, [one], workers, json)
    with said_line(json) as say:
        found = compare_intervals(
            answers[given], kinds=wanted, parameters=names, level=share, priors=priors, progress=say, **numbers
        )  # fmt: skip
    written = {"report": str(found.report(to))}
    if save_draws and found.draws is not None:
        written["draws"] = str(found.save_draws(save_draws))
    if json:
        return print_json(found.typed.printed(study=stored[given], written=written))
    verdict(found.record)
    screen.print("\n" + found.table(), markup=False)
    screen.print(f"\nReport: {', '.join(written.values())}", markup=False)
