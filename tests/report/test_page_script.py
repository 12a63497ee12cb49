"""plotly.js inside the pages: unchanged, with all that figures use, small, and quiet."""

import gzip
import hashlib
import re
from base64 import b64decode
from pathlib import Path

import plantfit
from plantfit.report.case_page import render_case_page

ROOM = Path(plantfit.__file__).parent
PUBLISHED = (
    "79542150855a52c567260e3137095dbe2b744e6d702a5cabe67da246942fba7a"  # of plotly-cartesian.min.js 4.1.1 on npm
)
KINDS = {"scatter", "bar", "box", "heatmap", "histogram", "histogram2d", "histogram2dcontour", "image", "pie",
         "contour",
         "scatterternary", "violin", "waterfall", "funnel"}  # fmt: skip
# of layouts and error bars
SHAPES = {"line", "rect", "circle", "path", "log", "linear", "category", "date", "data", "percent", "constant"}


def page():
    figure = {"data": [{"type": "scatter", "x": [0, 1], "y": [0, 1]}], "layout": {"height": 200}}
    return render_case_page({"title": "a", "sections": [{"title": "b", "figures": [{"figure": figure, "label": "c"}]}]})


def test_the_script_is_the_published_one_and_stands_in_the_page_whole():
    held = re.search(r'<script type="application/gzip" id="plotly">([A-Za-z0-9+/=]+)</script>', page())
    assert held
    script = gzip.decompress(b64decode(held[1]))
    assert hashlib.sha256(script).hexdigest() == PUBLISHED
    assert b"plotly.js (cartesian - minified) v4.1.1" in script[:400]


def test_figures_use_kinds_that_the_bundle_draws():
    found = set()
    for path in ROOM.rglob("*.py"):
        if {"report", "cases", "first_look"} & set(path.relative_to(ROOM).parts):
            found |= set(re.findall(r'"type": "([a-z0-9]+)"', path.read_text("utf-8")))
    assert {"scatter", "bar", "heatmap", "violin", "box"} <= found
    assert found <= KINDS | SHAPES


def test_a_page_of_one_figure_is_small_and_loads_nothing():
    text = page()
    assert len(text) < 750_000
    assert not re.search(r'(?:src|href)="(?:https?:)?//', text)
    assert '"showSendToCloud":false' in text
