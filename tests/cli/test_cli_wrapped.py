"""`plantfit check` of a sensor that begins anew at the end of its range."""

import numpy as np
from cli_call import call


def test_the_line_for_an_encoder_that_begins_anew_is_taken(tmp_path, capsys, monkeypatch):
    rng = np.random.default_rng(1)
    duty, w, angle, rows = np.repeat(rng.integers(40, 256, 20), 30), 0.0, 0.0, ["millis,pwm,angle_deg\n"]
    for k in range(600):
        rows.append(f"{20 * k},{duty[k]},{angle % 360:.1f}\n")
        w += 0.1 * (5.0 * duty[k] - w)
        angle += 0.02 * w
    (tmp_path / "m.csv").write_text("".join(rows))
    monkeypatch.chdir(tmp_path)
    assert call(capsys, monkeypatch, "init", "m.csv", "--yes").code == 0
    told = call(capsys, monkeypatch, "check", "m.toml").out
    assert "angle_deg leaps by" in told
    line = told.partition("Write: ")[2].partition("\n")[0].rstrip(".")
    study = (tmp_path / "m.toml").read_text().replace("split = 0.7", f"{line}\nsplit = 0.7")
    (tmp_path / "m.toml").write_text(study)
    again = call(capsys, monkeypatch, "check", "m.toml")
    assert again.code == 0, again.err
    assert "leaps by" not in again.out
    assert "runs on where it began anew" in again.out
