"""Tables of a comparison for papers: LaTeX (booktabs) and CSV."""

import csv
import io

from plantfit.findings.results.methods_compared import ComparisonOfMethods, MethodRuns, ProblemComparison

COLUMNS = ("best", "worst", "mean", "median", "std", "SEM", "95 % CI low", "95 % CI high", "evaluations", "seconds")
_SPECIAL = {c: f"\\{c}" for c in "&%$#_{}"} | {
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "\\": r"\textbackslash{}",
}


def csv_table(record: ComparisonOfMethods) -> str:
    """One row per problem and method; every digit, empty where a number does not exist."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("problem", "method", "runs", "failed", *COLUMNS))
    for problem in record.problems:
        for m in problem.methods:
            numbers = (repr(float(v)) if v == v else "" for v in _numbers(m))
            writer.writerow((problem.name, m.name, m.cost.n, m.cost.failed, *numbers))
    return text.getvalue()


def latex_table(record: ComparisonOfMethods) -> str:
    """A booktabs table with the lowest value of each cost column in bold; needs \\usepackage{booktabs}."""
    several = len(record.problems) > 1
    lead = ("Problem", "Method", "Runs") if several else ("Method", "Runs")
    head = (*lead, "Best", "Worst", "Mean", "Median", "Std", "SEM", r"95\,\% CI of the mean", "Evaluations", "Time [s]")
    lines = [
        r"\begin{tabular}{" + "l" * (len(lead) - 1) + "r" * (len(head) - len(lead) + 1) + "}",
        r"\toprule",
        _row(head),
        r"\midrule",
    ]
    for k, problem in enumerate(record.problems):
        lines += [r"\midrule"] if k else []
        lines += [_row(row) for row in _rows(problem, several)]
    lines += [r"\bottomrule", r"\end{tabular}"]
    note = (
        "% plantfit compare: 95 % CI is mean +- 1.96 SEM; evaluations "
        "and time are means over runs; bold: lowest; needs booktabs"
    )
    return "\n".join([note, *lines]) + "\n"


def _rows(problem: ProblemComparison, several: bool) -> list[tuple[str, ...]]:
    numbers = [_numbers(m) for m in problem.methods]
    lowest = [min((n[k] for n in numbers if n[k] == n[k]), default=None) for k in range(6)]
    rows: list[tuple[str, ...]] = []
    for k, (m, own) in enumerate(zip(problem.methods, numbers, strict=True)):
        bold = len(numbers) > 1
        cells = [_number(v, 6 if j < 4 else 3, bold and v == lowest[j]) for j, v in enumerate(own[:6])]
        low, high = (_number(v, 6) for v in own[6:8])
        interval = f"[{low}, {high}]" if own[6] == own[6] else "--"
        name = (_escaped(problem.name) if k == 0 else "",) if several else ()
        rows.append((*name, _escaped(m.name), str(m.cost.n), *cells, interval, _number(own[8], 6), _number(own[9], 4)))
    return rows


def _numbers(method: MethodRuns) -> tuple[float, ...]:
    c = method.cost
    spread = (c.minimum, c.maximum, c.mean, c.median, c.std, c.sem, *c.normal_interval)
    return (*spread, method.evaluations.mean, method.seconds.mean)


def _number(value: float, digits: int, bold: bool = False) -> str:
    if value != value:
        return "--"
    mantissa, _, power = f"{value:.{digits}g}".partition("e")
    text = rf"{mantissa} \times 10^{{{int(power)}}}" if power else mantissa
    return rf"$\mathbf{{{text}}}$" if bold else f"${text}$"


def _row(cells: tuple[str, ...]) -> str:
    return " & ".join(cells) + r" \\"


def _escaped(text: str) -> str:
    return "".join(_SPECIAL.get(c, c) for c in text)
