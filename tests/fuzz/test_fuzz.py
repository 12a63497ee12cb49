"""Broken inputs end in sentences: 500 with a seed of the day in the fast suite, many more in the slow one, and what was found before."""

import os
import sys
import time
import zlib
from base64 import b85decode

import numpy as np
import pytest
from fuzz_inputs import LAYERS, WORDS, drawn, mutated

from fuzz import Hang, fed, fuzz, limited, main
from plantfit.errors import BoardError, EquationError, RecordingError
from plantfit.recording import read
from plantfit.rig.board.protocol import Hello


@pytest.mark.parametrize("layer", LAYERS)
def test_the_good_file_of_a_layer_is_read(layer, tmp_path):
    assert fed(layer, LAYERS[layer].good(), tmp_path) == ("read", "")


def test_500_inputs():
    seed = int(os.environ.get("FUZZ_SEED", time.strftime("%Y%m%d")))
    print(f"FUZZ_SEED={seed}")  # shown when the test fails
    quick = tuple(layer for layer in LAYERS if layer != "mat")  # each of these takes a process
    counts, finds = fuzz(seed, 500, layers=quick)
    assert not finds, (seed, finds[0].layer, finds[0].number, finds[0].what)
    assert sum(counts.values()) == 500
    assert sum(n for (_, outcome), n in counts.items() if outcome == "refused") > 200


@pytest.mark.slow
@pytest.mark.parametrize("layer", [layer for layer in LAYERS if layer != "mat"])
def test_9800_inputs_of_a_layer(layer):
    counts, finds = fuzz(1, 9800, layers=(layer,))
    assert not finds, (finds[0].number, finds[0].what)
    assert sum(counts.values()) == 9800


@pytest.mark.slow
def test_many_matlab_files():
    assert not fuzz(1, 300, layers=("mat",))[1]


def test_inputs_are_a_function_of_the_seed():
    assert drawn("toml", 1, 2) == drawn("toml", 1, 2)
    assert len({drawn("toml", 1, n) for n in range(50)}) > 45
    assert len({mutated(b"abc def", np.random.default_rng(n)) for n in range(50)}) > 30
    assert WORDS


def test_the_fuzzer_finds(tmp_path, monkeypatch, capsys):
    """A reader that fails, says too much, or does not end, is a find."""
    monkeypatch.chdir(tmp_path)
    for error in (KeyError("x"), RecordingError(""), EquationError("Traceback (most recent call last)")):

        def fail(path, error=error):
            raise error

        monkeypatch.setitem(LAYERS, "csv", type(LAYERS["csv"])("x.csv", LAYERS["csv"].good, fail))
        assert fed("csv", b"", tmp_path)[0] == "find"
    monkeypatch.setattr(sys, "argv", ["fuzz", "--inputs", "2", "--seed", "5", "--layers", "csv"])
    assert main() == 1
    assert "2 inputs, 2 finds" in capsys.readouterr().out
    assert (tmp_path / "fuzz-finds" / "csv-5-0.input").read_bytes() == drawn("csv", 5, 0)
    monkeypatch.setattr("fuzz.SECONDS", 0.05)
    with pytest.raises(Hang), limited():
        sum(k for k in range(10**9))


# finds

CRASHING_MAT = (  # mat 476 of seed 1
    "c-r%I4DoSvQZUssQ1EpO(M`+DNmU5QNi0drFUqx2D9A6)tk6+#E=o--Nlj76&$ChpF3nT$%P&(fGEy+Kurjf*GO|=KGB7e@AOkRZ`tkv(0!9V~HXzLb#B3Z8"
    "DOM;SD8--wrWqMZfHWr%J1`=Qm^BjwcG^SellCUYAaEJVziAIq^#CgV*gicC1fD_VU)rBN0|IZL>OMflKSI@ihRT0|>iY&&_XDc#Csf^UsJcH;b^oC17#twt"
    "3=R<Wj1CZaCI^T<W(SBe7N|NFs5(}tIyR^}cBncIs5%a)I!>rME~q+gs5%~~Iv%JxUZ^@gs5*WJjBsbb9qyGF;r_vXlqQb`0QA7arv"
)


def test_a_matlab_file_at_which_the_reader_of_scipy_crashes_is_refused(tmp_path):
    (tmp_path / "x.mat").write_bytes(zlib.decompress(b85decode(CRASHING_MAT)))
    with pytest.raises(RecordingError, match=r"cannot be read|is damaged: reading it"):
        read(tmp_path / "x.mat")


def test_a_board_with_numbers_beyond_all_bounds_is_refused():
    for head in (("H", 1, "b", "1", 7, 1, "9" * 400, 64, 1), ("H", 1, "b", "1", 7, 1, 5, 64, 10**9), ("H", 1, "b", "1", 7, 1, 5, 64, 257)):
        hello = Hello()
        with pytest.raises(BoardError):
            hello.take([str(field) for field in head], "port")
