# ruff: noqa: RUF001 (true minus, times and dash signs are meant)

import json
import os
import re
from html.parser import HTMLParser

import pytest
from chromium import drawn
from findings_example import example
from jinja2 import meta
from markupsafe import escape

from plantfit.errors import PlantfitError, StoreError
from plantfit.findings import read_findings
from plantfit.report import html, render_html, summary_text, write_report

EVIL = "</script><script>alert(1)</script><img src=http://evil.example/x>"


class Page(HTMLParser):
    """Start tags, ids, and text outside scripts and styles."""

    def __init__(self, text: str):
        super().__init__()
        self.tags, self.ids, self.words, self._open = [], [], [], ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        self.ids += [value for key, value in attrs if key == "id"]
        self._open = tag

    def handle_endtag(self, tag):
        self._open = ""

    def handle_data(self, data):
        if self._open not in ("script", "style"):
            self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())


@pytest.fixture(scope="module")
def page():
    return Page(render_html(example(samples=300)))


def figures_in(text: str) -> dict:
    match = re.search(r'<script type="application/json" id="figures">(.*?)</script>', text, re.S)
    assert match
    return json.loads(match[1])


def test_sections_stand_in_order(page):
    wanted = [
        "verdict",
        "fit",
        "scores",
        "residuals",
        "parameters",
        "combinations",
        "search",
        "simulation",
        "cleaning",
        "reproduction",
    ]
    assert [i for i in page.ids if i in wanted] == wanted
    assert len(page.ids) == len(set(page.ids))


def test_numbers_and_words_are_there(page):
    for words in (
        "2.310 ± 0.040",
        "(3.20 ± 0.37)×10⁻⁵",
        "at its lower bound",
        "not determined",
        "Not white (p < 0.000001)",
        "Caution",
        "Problem",
    ):
        assert words in page.text


def test_every_figure_has_a_place_and_a_label(page):
    assert set(figures_in(render_html(example(samples=300)))) == {i for i in page.ids if i.startswith("figure-")}
    assert all(attrs.get("aria-label") for tag, attrs in page.tags if tag == "figure")


def test_many_directions_are_one_table_without_figures():
    findings = example(samples=50)
    drawn_once = len(figures_in(render_html(findings)))
    findings["combinations"] = [
        {
            "sentence": f"said {k}",
            "weights": {"Rm": 1.0, "Kt": -0.5, "J": 0.4, "Tf": 0.3, "Ks": 0.2},
            "relative_sd": 1.0 + k,
        }
        for k in range(50)
    ]
    text = render_html(findings)
    page = Page(text)
    assert len(figures_in(text)) == drawn_once - 1
    assert "said 7" not in page.text
    assert page.text.count("Rm +100 %, Kt -50 %, J +40 %, Tf +30 % and 1 more") == 50
    assert "50 directions" in page.text


def test_nothing_is_loaded_from_elsewhere(page):
    for tag, attrs in page.tags:
        assert not {"src", "srcset", "data", "poster"} & set(attrs), tag
        assert tag != "link"
        assert attrs.get("href", "#").startswith("#")
    policy = [attrs["content"] for tag, attrs in page.tags if attrs.get("http-equiv") == "Content-Security-Policy"]
    assert policy
    assert "default-src 'none'" in policy[0]
    assert "http" not in policy[0]


def test_names_from_outside_are_text_only():
    findings = example(samples=50)
    findings["name"] = EVIL
    recording = findings["recordings"][0]
    recording["name"], recording["log"] = EVIL, [EVIL]
    recording["outputs"][EVIL] = recording["outputs"].pop("w") | {"unit": EVIL}
    recording["inputs"][EVIL] = recording["inputs"].pop("u")
    findings["parameters"][0]["name"] = EVIL
    findings["runs"][0]["method"] = EVIL
    findings["reproduction"]["spec"] = EVIL
    plain, text = render_html(example(samples=50)), render_html(findings)
    assert "<script>alert" not in text
    assert [tag for tag, _ in Page(text).tags].count("script") == [tag for tag, _ in Page(plain).tags].count("script")
    assert not [tag for tag, _ in Page(text).tags if tag == "img"]
    for figure in figures_in(text).values():
        assert "<img" not in json.dumps(figure)  # plotly reads tags in its texts


def test_commands_in_sentences_have_the_type_of_commands():
    assert html.coded("Run `plantfit check a.toml` first.") == "Run <code>plantfit check a.toml</code> first."
    assert (
        html.coded(f"`{EVIL}` and {EVIL}, a lone ` too")
        == f"<code>{escape(EVIL)}</code> and {escape(EVIL)}, a lone ` too"
    )


def test_embedded_json_cannot_end_its_element_and_reads_back():
    value = {"a": EVIL + "\u2028&<!--"}
    text = html.embedded(value)
    assert not set("<>&\u2028") & set(text)
    assert json.loads(text) == value


def test_only_a_name_is_needed():
    page = Page(render_html({"name": "empty"}))
    assert "No verdict was made" in page.text
    assert not [i for i in page.ids if i.startswith("figure-")]
    assert summary_text({"name": "empty"}).startswith("empty")


def test_says_that_validation_is_missing():
    findings = example(samples=50)
    findings["scores"] = [s for s in findings["scores"] if s["part"] == "fit"]
    assert "No unseen data: give validation" in Page(render_html(findings)).text
    assert "No unseen data: give validation" in summary_text(findings)


def test_unknown_numbers_are_dashes():
    findings = example(samples=50)
    findings["parameters"][0] |= {"value": float("nan"), "standard_error": float("inf"), "low": None, "high": None}
    findings["runs"][0] |= {"cost": None, "rmse": float("nan"), "history": {"evaluations": [], "cost": []}}
    text = Page(render_html(findings)).text
    assert "nan" not in text.split()
    assert "Rm –" in text


def test_long_recordings_are_decimated_and_say_so(tmp_path):
    findings = example(samples=100_000)
    findings["recordings"][0]["outputs"]["w"]["measured"][70_001] = 1234.0
    path = write_report(findings, tmp_path / "long.html")
    assert path.stat().st_size < 10e6
    text = path.read_text(encoding="utf-8")
    assert "Shown decimated" in Page(text).text
    assert 1234.0 in figures_in(text)["figure-1"]["data"][0]["y"]


def test_many_recordings_stay_small_and_say_nothing_twice():
    findings, log = example(samples=4000), ["Read from {}.csv.", "One comment line was skipped.", "Time from 't' in s."]
    first = findings["recordings"][0]
    findings["recordings"] = [
        {**first, "name": f"r{k}", "log": [line.format(f"r{k}") for line in log]} for k in range(10)
    ]
    findings["recordings"][3]["log"] = ["Something else was done."]
    findings["recordings"].append({**example(samples=2000)["recordings"][0], "name": "short", "log": []})
    text = render_html(findings)
    assert len(text.encode()) < 1.5e6, (
        "a figure for each recording makes the page too large: limit how many there are, as MOST_INTERVALS"
    )
    page = Page(text).text
    for once in ("Shown decimated", "samples used to fit", *log[1:]):
        assert page.count(once) == 1, once
    assert "r1, else as r0" in page
    assert re.search(r'<li value="1">Read from r9.csv.</li></ol>', text)
    assert "r3, else" not in page
    assert re.search(r"lowest and highest of every \d+ to \d+ samples. All numbers use all samples.", page)
    assert "Something else was done." in page


def test_finely_alternating_parts_are_not_shaded():
    findings = example(samples=1000)
    findings["recordings"][0]["outputs"]["w"]["part"] = ["fit", "validation"] * 500
    assert "too finely to be shaded" in Page(render_html(findings)).text


@pytest.mark.parametrize(
    ("spoil", "place"),
    [
        (lambda f: f.pop("name"), "name"),
        (lambda f: f["parameters"][2].update(value="many"), "parameters.2.value"),
        (lambda f: f["recordings"][0]["t"].pop(), "recordings.0"),
        (lambda f: f["verdict"][0].update(level="great"), "verdict.0.level"),
        (lambda f: f["runs"][1]["history"]["cost"].pop(), "runs.1.history"),
    ],
)
def test_a_wrong_record_is_named(spoil, place):
    findings = example(samples=50)
    spoil(findings)
    with pytest.raises(PlantfitError, match=re.escape(f"wrong at {place} ")):
        render_html(findings)


def test_missing_folder_and_folder_as_file(tmp_path):
    with pytest.raises(StoreError, match="does not exist; create it first"):
        write_report({"name": "a"}, tmp_path / "no" / "a.html")
    with pytest.raises(StoreError, match="it is a folder"):
        write_report({"name": "a"}, tmp_path)


def test_full_disk_keeps_the_old_report(tmp_path, monkeypatch):
    path = tmp_path / "a.html"
    old = html._MARK + "old"
    path.write_text(old)

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(StoreError, match="No space left on device"):
        write_report(example(samples=50), path)
    assert path.read_text() == old
    assert list(tmp_path.iterdir()) == [path]


def test_the_template_shows_all_that_the_page_is_given():
    """Jinja says nothing of a value that no template uses: a new section would not appear."""
    used = {
        n
        for name in ("report.html", "frame.html")
        for n in meta.find_undeclared_variables(html.environment().parse(html.template_text(name)))
    }
    given = set(html._context(read_findings(example(samples=50))))
    assert given - used == set()
    assert "fits" in given


def test_summary_holds_verdict_and_parameters():
    text = summary_text(example(samples=50))
    lines = text.splitlines()
    assert "Caution: Tf lies at its lower bound" in text
    assert any(line.split()[:4] == ["Rm", "2.310", "±", "0.040"] for line in lines)
    assert max(map(len, lines)) <= 120
    assert "\x1b" not in summary_text(example(samples=50) | {"name": "a\x1b[31m\nb"})


def test_chromium_draws_every_figure_without_a_share_button(tmp_path):
    document = drawn(write_report(example(samples=200), tmp_path / "report.html"), tmp_path / "profile")
    page = Page(document)
    count = len(figures_in(document))
    assert count == 17, (
        f"the example page has {count} figures: write this number here if a figure was added to the report on purpose"
    )
    assert sum("main-svg" in (attrs.get("class") or "") for tag, attrs in page.tags if tag == "svg") >= count
    titles = [attrs.get("data-title") or "" for _, attrs in page.tags]
    assert any("Download plot" in title for title in titles)  # the bar is there, so that the next line can fail
    assert not any("share" in title.lower() or "cloud" in title.lower() for title in titles)


def correlated(noise="correlated", taken=False):
    """Findings whose residual of i is not white: noise explains it, or moves the parameters too far."""
    findings = example(samples=50)
    row = {"name": "a", "unit": "V", "value": 1.0, "low": 0.9, "high": 1.1}
    findings["correlated"] = {
        "noise": [
            {"output": "i", "unit": "A", "deviation": 0.1, "order": 1, "correlation": 0.5, "samples": 300,
             "independent": 100.0, "left": 0.01, "shared": None, "form": None},
        ],
        "parameters": [row], "p": 0.5 if noise == "correlated" else 1e-6, "moved": "a",
        "differs": noise != "correlated", "least_squares": [row] if taken else None,
    }  # fmt: skip
    return findings


MISSING = "the residuals follow a pattern that the model does not explain"
LEFT_BY_NOISE = "noise that is correlated leaves such a pattern; the standard errors allow for that."
BY_LEAST_SQUARES = "Searches are by least squares, and so are the costs and values of this section."


def test_what_noise_leaves_is_no_fault_of_the_model_on_the_page_either():
    assert MISSING in render_html(example(samples=50))
    assert LEFT_BY_NOISE in render_html(correlated(taken=True))
    wrong = render_html(correlated("a fault", taken=True))
    assert MISSING in wrong
    assert LEFT_BY_NOISE not in wrong
    assert MISSING in render_html(correlated())  # before additions were tried, where nobody says that it is noise
    shared = example(samples=50)
    shared["residual_tests"][1]["shared"] = "i_slot"
    text = render_html(shared)
    assert "the errors of i come back with i_slot, which leaves such a pattern" in text
    assert MISSING not in text


def test_of_a_weighted_answer_the_search_is_said_to_be_by_least_squares():
    assert BY_LEAST_SQUARES in render_html(correlated(taken=True))
    assert BY_LEAST_SQUARES not in render_html(correlated())
    assert BY_LEAST_SQUARES not in render_html(example(samples=50))
