"""Broken inputs end in sentences: 500 with a seed of the day in the fast suite, many more in the slow one, and what
was found before."""

import os
import subprocess
import sys
import time
import zlib
from base64 import b85decode
from pathlib import Path

import numpy as np
import pytest
from fuzz_cli import judged
from fuzz_inputs import LAYERS, SHAPED, WORDS, drawn, mutated

from fuzz import Hang, fed, fuzz, limited, main
from plantfit.cli.commands.begin.init import init
from plantfit.errors import BoardError, EquationError, RecordingError, StoreError
from plantfit.recording import describe, read
from plantfit.recording.readers.panics import unheard
from plantfit.rig.board.protocol import Hello
from plantfit.study import Store


@pytest.mark.parametrize("layer", LAYERS)
def test_the_good_file_of_a_layer_is_read(layer, tmp_path):
    assert fed(layer, LAYERS[layer].good(), tmp_path) == ("read", "")


@pytest.mark.thorough
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


@pytest.mark.parametrize("layer", SHAPED)
@pytest.mark.further(2)
def test_inputs_come_past_the_parser(layer, tmp_path):
    """Else the rooms behind it are not tried: of files that are whole and wrong inside some are read and some
    refused."""
    inputs = [SHAPED[layer](np.random.default_rng([3, n])) for n in range(40)]
    assert inputs[:5] == [SHAPED[layer](np.random.default_rng([3, n])) for n in range(5)]
    assert {fed(layer, content, tmp_path)[0] for content in inputs} == {"read", "refused"}


def test_inputs_are_a_function_of_the_seed():
    assert drawn("toml", 1, 2) == drawn("toml", 1, 2)
    assert len({drawn("toml", 1, n) for n in range(50)}) > 45
    assert len({mutated(b"abc def", np.random.default_rng(n)) for n in range(50)}) > 30
    assert WORDS


def test_the_fuzzer_finds(tmp_path, monkeypatch, capsys):
    """A reader that fails, says too much, or does not end, is a find."""
    monkeypatch.chdir(tmp_path)
    code = RecordingError("x.csv: 'int' object is not iterable; correct it.")
    for error in (KeyError("x"), RecordingError(""), EquationError("Traceback (most recent call last)"), code):

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


CLI = Path(__file__).with_name("fuzz_cli.py")


def through_the_cli(tmp_path, *words):
    done = subprocess.run(
        [sys.executable, str(CLI), *words], cwd=tmp_path, capture_output=True, text=True, timeout=7200
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork, which this system lacks")
@pytest.mark.thorough
def test_some_inputs_through_the_cli(tmp_path):
    assert "24 calls, 0 finds" in through_the_cli(
        tmp_path, "--inputs", "24", "--seed", "1", "--layers", "csv,store,json"
    )


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork, which this system lacks")
def test_2000_inputs_through_the_cli(tmp_path):
    assert "2000 calls, 0 finds" in through_the_cli(tmp_path, "--inputs", "2000", "--seed", "1")


def test_what_the_fuzzer_of_the_cli_finds():
    sentence = "plantfit: x.csv is broken.\n"
    assert judged(5, sentence, 1.0, 2**20) is None
    assert judged(0, "", 1.0, 2**20) is None
    assert judged(0, "", 60.0, 2**20) is None  # compiled what is good
    own = "plantfit: made.toml is not valid TOML.\n"
    for found in ((-11, "", 1.0, 0), (70, sentence, 1.0, 0), (5, "Traceback", 1.0, 0), (5, "", 1.0, 0),
                  (5, "x\n" * 30, 1.0, 0),
                  (5, sentence, 20.0, 0), (0, "", 100.0, 0), (7, own, 1.0, 0), (0, "", 1.0, 2**32),
                  (1, sentence, 1.0, 0)):  # fmt: skip
        assert judged(*found), found


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


def test_a_study_with_a_unit_that_has_no_size_is_refused(tmp_path):
    """'m**1e9' where seconds are needed: in other units of length, which are tried then, its size is 0."""
    outcome, said = fed("toml", drawn("toml", 1, 5880), tmp_path)
    assert (outcome, "A delay must be in s" in said) == ("refused", True)


def test_a_board_with_numbers_beyond_all_bounds_is_refused():
    for head in (
        ("H", 1, "b", "1", 7, 1, "9" * 400, 64, 1),
        ("H", 1, "b", "1", 7, 1, 5, 64, 10**9),
        ("H", 1, "b", "1", 7, 1, 5, 64, 257),
    ):
        hello = Hello()
        with pytest.raises(BoardError):
            hello.take([str(field) for field in head], "port")


PANICKING_PARQUET = (  # export 1798 of seed 1
    "c-pmBU2GKB6`r*>#(+f)@eI4|CYdg<HNou8uK%eCjBT)~*Qsp<8{3QM?Ck9B*t0X+`LTDgT%{z6tSYKdm4`GBl&1<sJfu}xr7u-lA)fk>mr8laLli}QsAz>ygizJ0J?G"
    "BPj_q9ohAuF3?)mx7ch5cd&Si?9Nzy_30L`Z9CYqwC&fg{e!|oZRsAd?H4UMMgb~@SxKJ9c1-4f}eI-5Zq!iVeL%2QMm41xiwnQjaBQZ4P_P)kWNi&~CuV}i^I^Fbgs9"
    "BbVY4WKNYO2f-VYX2$a{Q}M#7#yOHZeq~t+Cr^0e;Z-%1(!>pxrq)sWSVtLB}{Gvm_G+%cbj7W3N!>FnWFxB-~@eiwid*P64*j#Q)yf_K|_-4!n_+`J_^LX4#sW;8v@m"
    "*L+wC^YFM4RbXxO*tXR5a_$Xc56T90O46=35F+Zh!(-hSLgRGS+NM;>UEw&}(ymxLL!xT)*rn3=XZU<tw_r~tE)`fvoUG!_1it^_F!7uUmhch8ha?>%tanrdL_f78$AE"
    "R1eZA8s5N#>t0*P#ykhZ-T)%WRjY=WNK6wrBQP$lJ}lUs@3qOE6_kHEIMNwhc7`e%@2xV@RT==6uN?9oWU}@1F^IQlr@u3we99FAKT=M~0-c6Ey-4+J_ne*9fp%8{exE"
    ")v)~3S@&IsK)OcYn?pm5fPugQeZGrs-By7wJ))m^6*&1<I8Kp4^S<W)f(Mv_RQJKRzF&Up#f~EmiGe^RsK|!7M^dDcq+%boLi;oCLmzYuHA+B;r0Wr>^-FCjPX2?UDjp"
    "HgLo2;Nbsv7S@6FIBf7<)AgD#gBi@-$Ft5<w|S(n|7Ky2giP@}BR!Vai`sV=)VmmTicMzrpP8`BEXZS>3jBdjH9x5(Oho#U%%Z9N44c09ITkSeAwklraX?*(EXMq&@Xv"
    "ne=yuqjNwefE>4!i=Nz4%cw)==YlgJDYvc@U)!MG3*|beph!3`^4=?J!gI5Q%B!F;}h%9JnIv;n?I{Xf4MVw&)Fw8L;cCaQAL<x`bP{!q`OV@iX(m<q)kV>w#O51@1+%"
    "2yPv)uaO8(=HTltjn*5->CVz9t=ifoU@5&p8=^L(mCtQ<1jL;br>89|%>G7bhX(k<^=(b}`?uF_Ym5z{4FsSfaV@u>pVT<19+zGQkrf%3ibjCeni~f&}t#Q8sj@@@GZ_"
    "}iy-lkBX0(+<>Jp|yr!4TPrbdv++>_~L0cbYs=;HHiK_y{s*dnY<mW`f~J_+IRbK;&uerp&uX=?><Lm*`ii*hVn2yPG6)^C-<Q@4QUEM#bK1iR|(M$ow8r?husUwnm=e"
    "-p2d|k*>XhNT2VE?CQeBe1#aFzC!m=v0t=Bp8np%JUU8;n1_VKI|m}WzWy-Rj{(ldEaGgmM|O3KVQwMD1A=kwP-NGa5$03G`RKcd^L9sM*LMo$bHw>4!TC88d8TUtb04"
    "v8M-l7Sp~!RotTP)iK>s^I|LWV3=k-};ZX)chBMAG)mm*K`ZDl@*L0|su2pyxC8{cAru~z2h!45c7yFzXJ%*+qxP8niRDhZ+6dlUHU7DsuWKL`K#ffX26rg?izR1-XJ@"
    "FV0s&7YV8`|2v{FYtW9@$13&BoFE&swdEWSVQv^j`;$NM=wG+Uq<(Fei&2XxR)Ri90EE_9!rCX#K1i7lCtv*pXZ&QZ70KpOGQpBog<Nnd?GQ0%F$_uAN*!6x+vsvX{sA"
    "S2_A78Ax`H;UFf-$ewZJI4lg4fF^m<<V)x97s4DsS)Zo<|@f^AMB>4=?*FD`ZpYG)w=|Q}6tDEyJTv{k*$7hSVF=ZvIPV)VT#}(X4xp=c)>BxBL1WZ!gT0gtO_{+i~4v"
    "cvIV+yx0#}Ui;6!IbUB#SzY<H~A7{!`d5gg>9ghd6e=IzN|Ga$~dA3ose+G4a_Q;|*SWOuSl)A1Cpt*`;i%cUfE=olJmjyjB!@eWoX!$k7RGeY-RUIw`r*c_TM>o)hK<"
    "Er=h$_zR8W`<(bOo}Wh-QtDcN@CMq)w#Ls)yVQw&81s+6&dpz%Ns2JdS=?V$e(QWk+@NK&+e<a<*~b=&!dxXOmS(TonU)f6lW$u8f&()72G|GrS{8f^UtO4+T_(CTiPs"
    "v&Pi>7a@FUacTCjKV_z#lV!YG+vx;BY<Z~j=U0{G*5+OCVcpb2umOrwdEE;~2N31fr6>-1^(ewP(NHS@9=`c>OnG_UC;!Hk|_qpq4YOe<GqQ_(IqN<=WOMOFCjpjSZ>^"
    "pXZgGMYtQ5=<$F`V^PyJDE(LOm)A(ai@~WQ{3PQ5I7F~5V|pneR(oKzZiwPQuH$D;8ui+6o~dk0S6p1l1RQJ5lvH83+T7Dj%<pSx(tI}kPEtyli@3IMJx(>0duOBqJUv"
    "Z5Vfo<sGAKKZj>eQiV5EZB#1=W(`+VM#2M<DXhvPs;Ub{tAY(i$sbcYRM$OBL?N!jUTwF9((9e{eP?KFWE~Cbf3#y<Ppj=}uVzSu9Sul06RWhuyi=`5b*>!L(E3gKqSu"
    "Wn6QAI@(R2VF-!Kz4Q;;d+^Wx+5o+6J}}aV%P<me0dD8RuA-lP?NPB*GMQ8@-oZhZ!uEw49`XApO|+b`x*%N3DDh2AvbHf`?G;w7S^zarPuzInE|nQ?N2BlCNY`*Iic2"
    "mg%46tTQ9H3`(}XVp~-*!%VbPLQXOaWoH^y48b7HGCj1a=Zuy`?-FFhCxCfYv*3D$MdIQd^hFY0p!Ow6%#!u<#R2^-kr3Ex2O6T_tg50FFwjFXw!);hrte}?Hb$+?+u{"
    "xAebPNn-(zS78$S~TB{n{2x&fH<JuW840V4E0$o(Eb+--jdf?!gpvR1YfvWz5*RLfFDNjC*qHLDP!8k!CPTHdX8MqQTGoZZCWgbGD25yH?!KJv%V6m|DWSul&WO(kk%W"
    "8gBAT|9w)X|j=5pibCUWc!z^Fk?IkqTTUiGT!f=4S4LJ7M3AS4vZzC;*7a?%26nCcC${kO64j!d*VIuK0-~DZA~(s?2jjjiWH0RijpWvEy${5?{QOJk%&_j_DKnKX<4-"
    "@Y-OPDN?%Wu94ciC_59>0dv0oegyhwndAbMHm7GQpQ|{Q*OhG{fB9wJ4OY-smm*45r$jKCpWx{FAIZnxm4u>h&^0IDVc{#FDmTEdw9oD99N#yjD#O1Ok6EiszFRxRf*Q"
    "Yc^&<(cJUb^F~v!2lBc*b;QEm_I2{rN#ImCbeM^SM-iK0lDkC3{l+0|GZFqy~HQ`Bc7NkaB~m<KcVoKj<g?OMTo<QB(X(@_!*7_S6"
)


def test_a_parser_that_panics_in_rust_says_nothing_beside_the_sentence(tmp_path, capfd):
    """polars 2.1 prints two traces of the stack before it raises."""
    (tmp_path / "x.parquet").write_bytes(zlib.decompress(b85decode(PANICKING_PARQUET)))
    with pytest.raises(RecordingError, match=r"x\.parquet cannot be read"):
        read(tmp_path / "x.parquet")
    with pytest.raises(StoreError, match=r"x\.parquet is a broken Parquet file"):
        Store.open(tmp_path / "s.db").import_file(tmp_path / "x.parquet")
    assert capfd.readouterr().err == ""


def test_what_no_panic_wrote_is_not_lost(capfd):
    with unheard():
        os.write(2, b"a warning\n")
    with unheard():
        os.write(2, b"thread 'x' panicked at y\n")
    assert capfd.readouterr().err == "a warning\n"


def test_dates_beyond_the_calendar_of_python_are_described(tmp_path):
    """npz 83 of seed 1 through the command line: "year -80233 is out of range"."""
    far = np.array([-2_600_000_000_000, 0, 2_600_000_000_000], "datetime64[s]")
    np.savez(tmp_path / "x.npz", t=np.arange(3.0), y=np.arange(3.0), z=far)
    first = describe(tmp_path / "x.npz").columns[2].first
    assert int(first[0]) < int(first[1]) == 0 < int(first[2])
    np.savez(tmp_path / "x.npz", t=far, y=np.arange(3.0), z=np.arange(3.0))  # npz 133 of seed 6: InvalidOperationError
    assert "dates before 1678 or after 2261" in str(describe(tmp_path / "x.npz").problem)
    with pytest.raises(RecordingError, match="time column 't' holds dates before 1678"):
        read(tmp_path / "x.npz")
    near = np.array([0, 1, 2], "datetime64[s]")
    np.savez(tmp_path / "x.npz", t=np.arange(3.0), y=np.arange(3.0), z=near)
    assert describe(tmp_path / "x.npz").columns[2].first[0] == "1970-01-01 00:00:00"


def test_init_never_blames_the_file_that_it_writes(tmp_path):
    """xlsx 32 of seed 1: "made.toml, [model]: a bound of parameter 'u0' is -inf"."""
    rows = "".join(f"{k},{(-1) ** (k // 3)}e308,{(k * 7) % 11}.5\n" for k in range(30))
    (tmp_path / "x.csv").write_text("t [s],u [V],y [mm]\n" + rows)
    with pytest.raises(RecordingError, match="No study file that runs can be made from this recording"):
        init(str(tmp_path / "x.csv"), None, False, True)
    assert not (tmp_path / "x.toml").exists()
