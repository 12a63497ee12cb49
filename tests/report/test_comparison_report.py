import csv
import io
import json
import re
import sys
from pathlib import Path

import pytest
from chromium import drawn
from findings_example import example

from plantfit.errors import StoreError
from plantfit.findings import read_findings
from plantfit.findings.results.methods_compared import ComparisonOfMethods
from plantfit.report import render_comparison, render_html, write_comparison
from plantfit.report.drawings import Drawings
from plantfit.report.sections.comparison import of_findings
from plantfit.report.sections.paper_tables import csv_table, latex_table
from plantfit.study.comparing.problem_runs import ProblemRuns
from plantfit.study.comparing.record import compared

sys.path.append(str(Path(__file__).resolve().parents[1] / "study"))
from method_runs import made_run, two_methods

EVIL = "</script><script>alert(1)</script><img src=http://evil.example/x>_%{y}"


def figures_in(text: str) -> dict:
    match = re.search(r'<script type="application/json" id="figures">(.*?)</script>', text, re.S)
    assert match
    return json.loads(match[1])


def points(figure) -> int:
    return sum(len(trace["x"]) for trace in figure["data"])


@pytest.fixture(scope="module")
def record():
    return compared(
        [ProblemRuns("bench", tuple(two_methods(25)), ("p0", "p1", "p2"), floor=0.012, studies=(3,))], asked=[0.05]
    )


@pytest.fixture(scope="module")
def page(record):
    return render_comparison(record)


def test_every_part_of_a_comparison_is_there(page):
    text = page[: page.index('<script type="application/json"')]
    for words in (
        "50 runs of early and late on 1 problem", "late beats early", "Pairs of methods", "Convergence",
        "Target 0.05 (asked for)",
        "Target 0.012 (noise floor)", "Sorted final costs", "Parameters of the best runs",
        "Distinct answers of the same cost", "Study 3.",
    ):  # fmt: skip
        assert words in text
    figures = figures_in(page)
    assert len(figures) == 10
    assert {f'id="{name}"' for name in figures} == set(re.findall(r'id="figure-\d+"', text))
    assert text.count("<figure aria-label=") == 10
    kinds = {trace["type"] for figure in figures.values() for trace in figure["data"]}
    assert kinds == {"scatter", "violin", "bar"}


def test_axes_say_what_they_show(page):
    titles = [[f["layout"][a]["title"]["text"] for a in ("xaxis", "yaxis")] for f in figures_in(page).values()]
    assert ["evaluations", "best cost so far"] in titles
    assert ["seconds", "best cost so far"] in titles
    assert ["evaluations", "targets reached [%]"] in titles


def test_nothing_is_loaded_and_names_are_text(record):
    evil = ComparisonOfMethods(**json.loads(json.dumps(record.plain()).replace('"late"', json.dumps(EVIL))))
    text = render_comparison(evil)
    assert "<script>alert" not in text
    assert text.count("<script") == render_comparison(record).count("<script")
    assert "default-src 'none'" in text
    assert "<img" not in json.dumps(figures_in(text))


def test_many_runs_stay_small_and_smooth():
    runs = [
        made_run(r.method, r.run + 1000 * copy, r.history_evaluations, r.history_cost * (1 + 1e-3 * copy), x=r.x)
        for copy in range(5)
        for r in two_methods(100)
    ]
    text = render_comparison(compared([ProblemRuns("bench", tuple(runs), ("p0", "p1", "p2"))]))
    assert len(text.encode()) < 6e6
    for figure in figures_in(text).values():
        assert points(figure) < 2500
        assert len(figure["data"]) < 20


def test_costs_over_decades_are_boxes_on_a_log_axis():
    runs = [made_run("a", k, [1, 10], [9.0, 10.0 ** -(k % 7)]) for k in range(30)]
    figure = figures_in(render_comparison(compared([ProblemRuns("wide", tuple(runs))])))["figure-1"]
    assert {t["type"] for t in figure["data"]} == {"box"}
    assert figure["layout"]["yaxis"]["type"] == "log"


def test_failed_runs_and_single_ones_still_make_a_page():
    nothing = [made_run("a", k, [5], [float("nan")]) for k in range(3)]
    assert "rank last" in render_comparison(compared([ProblemRuns("x", tuple(nothing))]))
    assert "bench" in render_comparison(compared([ProblemRuns("bench", (made_run("a", 0, [5], [0.25]),))]))


def test_several_problems_stand_before_each_one():
    problems = [ProblemRuns(f"p{k}", tuple(two_methods(6, seed=k))) for k in range(3)]
    text = render_comparison(compared(problems))
    assert text.index("Over all problems") < text.index('id="problem-1"') < text.index('id="problem-3"')
    assert "Data profile" in text


def test_missing_folder(record, tmp_path):
    with pytest.raises(StoreError, match="does not exist; create it first"):
        write_comparison(record, tmp_path / "no" / "a.html")


def test_csv_holds_every_digit(record):
    rows = list(csv.DictReader(io.StringIO(csv_table(record))))
    late = record.problems[0].methods[1]
    assert [r["method"] for r in rows] == ["early", "late"]
    columns = {"best": "minimum", "worst": "maximum", "mean": "mean", "median": "median", "std": "std", "SEM": "sem"}
    assert {name: float(rows[1][name]) for name in columns} == {
        name: getattr(late.cost, key) for name, key in columns.items()
    }
    assert float(rows[1]["95 % CI high"]) == late.cost.normal_interval[1]
    assert (float(rows[1]["evaluations"]), float(rows[1]["seconds"])) == (2000.0, late.seconds.mean)


def test_latex_is_booktabs_with_the_lowest_in_bold(record):
    text = latex_table(record)
    assert [text.count(rule) for rule in (r"\toprule", r"\midrule", r"\bottomrule")] == [1, 1, 1]
    rows = [line for line in text.splitlines() if line.endswith(r"\\")]
    assert {line.count("&") for line in rows} == {10}
    assert r"\mathbf" in rows[2]
    assert r"\mathbf" not in rows[1]
    renamed = ComparisonOfMethods(**json.loads(json.dumps(record.plain()).replace('"late"', '"salp_swarm & 50 %"')))
    assert r"salp\_swarm \& 50 \%" in latex_table(renamed)
    one = compared([ProblemRuns("x", (made_run("a", 0, [5], [2.5e-9]),))])
    assert r"$2.5 \times 10^{-9}$" in latex_table(one)
    assert "--" in latex_table(one)


def test_the_report_of_a_study_has_the_section_for_several_runs():
    findings = example(samples=50)
    text = render_html(findings)
    assert 'id="comparison"' in text
    assert "Median final cost" in text
    few = findings | {"runs": findings["runs"][:2]}
    assert 'id="comparison"' not in render_html(few)
    section = of_findings(read_findings(findings), Drawings())
    assert section
    assert len(section["costs"].rows) == len({r["method"] for r in findings["runs"]})


def test_chromium_draws_every_figure(page, tmp_path):
    path = tmp_path / "compare.html"
    path.write_text(page, encoding="utf-8")
    document = drawn(path, tmp_path / "profile")
    assert document.count('class="main-svg"') >= len(figures_in(document))
    assert "Download plot" in document
    assert 'data-title="Share' not in document
