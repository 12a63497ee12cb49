"""Waveforms against closed forms: spectra, autocorrelation, crest factors, limits held, C headers compiled."""

import shutil
import subprocess

import numpy as np
import pytest

from plantfit.errors import RecordingError
from plantfit.recording import Recording, Signal, read_csv, to_csv
from plantfit.recording.excitation import (
    amplitude_spectrum,
    chirp,
    crest_factor,
    limited,
    multisine,
    prbs,
    sine_square,
    staircase,
    to_c_header,
)
from plantfit.recording.excitation.prbs import TAPS, lfsr_bits


@pytest.mark.parametrize("order", range(2, 15))
def test_registers_run_through_all_states(order):
    bits = lfsr_bits(order, 1, 2 * (2**order - 1))
    length = 2**order - 1
    np.testing.assert_array_equal(bits[:length], bits[length:])
    # every window of `order` bits occurs once in a period: the definition of maximum length
    windows = np.lib.stride_tricks.sliding_window_view(bits[: length + order - 1], order) @ (1 << np.arange(order))
    assert len(np.unique(windows)) == length


@pytest.mark.parametrize("order", [15, 16, 17, 18, 19, 20])
def test_long_registers_have_primitive_polynomials(order):
    """x has order 2^n - 1 modulo the feedback polynomial: no proper divisor of it gives 1."""
    polynomial = 1 | sum(1 << tap for tap in TAPS[order])

    def times(a, b):
        product = 0
        while b:
            product ^= a if b & 1 else 0
            a = a << 1 ^ (polynomial if a << 1 >> order else 0)
            b >>= 1
        return product

    def power(exponent):
        result, base = 1, 2
        while exponent:
            result = times(result, base) if exponent & 1 else result
            base, exponent = times(base, base), exponent >> 1
        return result

    length = 2**order - 1
    primes = {p for p in range(2, 1100) if length % p == 0 and all(p % q for q in range(2, int(p**0.5) + 1))}
    rest = length
    for p in primes:
        while rest % p == 0:
            rest //= p
    primes |= {rest} - {1}
    assert power(length) == 1
    assert all(power(length // p) != 1 for p in primes)


def test_prbs_autocorrelation_is_the_closed_form():
    amplitude, length = 6.0, 2**9 - 1
    v = prbs(amplitude, 100, order=9, seed=4)["V"]
    assert len(v) == length
    circular = np.fft.irfft(np.abs(np.fft.rfft(v)) ** 2, length) / length
    np.testing.assert_allclose(circular[0], amplitude**2)
    np.testing.assert_allclose(circular[1:], -(amplitude**2) / length, atol=1e-9)
    _, lines = amplitude_spectrum(v, 100)
    np.testing.assert_allclose(lines[1:], 2 * amplitude * np.sqrt(length + 1) / length, rtol=1e-9)  # flat


def test_prbs_holds_bits_and_starts_by_seed():
    held = prbs(2.0, 50, 10, hold=5, seed=1, offset=1.0)["V"]
    assert set(held) == {-1.0, 3.0}
    assert len(held) == 500
    np.testing.assert_array_equal(held.reshape(-1, 5), np.repeat(held[::5], 5).reshape(-1, 5))
    np.testing.assert_array_equal(held, prbs(2.0, 50, 10, hold=5, seed=1, offset=1.0)["V"])
    assert np.any(held != prbs(2.0, 50, 10, hold=5, seed=2, offset=1.0)["V"])


@pytest.mark.parametrize("phases", ["crest", "schroeder", "random"])
def test_multisine_has_its_lines_and_no_others(phases):
    v = multisine(5.0, 200, 5.0, low=0.4, high=20, periods=2, odd=True, phases=phases, seed=3)["V"]
    frequencies, lines = amplitude_spectrum(v, 200)
    wanted = np.isin(np.round(frequencies * 5, 9), np.arange(3, 101, 2))
    assert np.max(np.abs(v)) == pytest.approx(5.0)
    np.testing.assert_allclose(lines[wanted], lines[wanted][0], rtol=1e-9)
    assert np.max(lines[~wanted]) < 1e-12
    np.testing.assert_allclose(v[:1000], v[1000:], atol=1e-12)


@pytest.mark.parametrize("count", [15, 31, 99])
def test_optimised_phases_beat_schroeder_and_random(count):
    def crest(phases, seed=0):
        return crest_factor(multisine(1.0, 100, 20.0, low=0.05, high=0.05 * count, phases=phases, seed=seed)["V"])

    schroeder, best = crest("schroeder"), crest("crest")
    assert 1.5 < schroeder < 2.0  # about 1.7 for a flat spectrum (Schroeder 1970)
    assert best < 1.45  # a single sine has 1.414; Van der Ouderaa et al. reach 1.40 to 1.42
    assert best < schroeder < np.median([crest("random", seed) for seed in range(9)])


def test_chirp_runs_through_its_band():
    v = chirp(3.0, 500, 40, low=1, high=20, sweep="linear")["V"]
    frequencies, lines = amplitude_spectrum(v, 500)
    power = lines**2
    assert power[(frequencies > 0.8) & (frequencies < 21)].sum() > 0.995 * power.sum()
    phase = np.unwrap(np.angle(_analytic(v)))
    told = np.diff(phase[2000:18001:500]) / (2 * np.pi)  # turns in every second
    np.testing.assert_allclose(told, 1 + 19 * (4.5 + np.arange(len(told))) / 40, atol=0.03)
    # logarithmic: equal time for each octave
    slow = np.unwrap(np.angle(_analytic(chirp(3.0, 500, 40, low=1, high=16)["V"])))
    assert slow[15000] - slow[10000] == pytest.approx(2 * (slow[10000] - slow[5000]), rel=0.01)


def _analytic(v):
    spectrum = np.fft.fft(v)
    spectrum[len(v) // 2 :] = 0
    return np.fft.ifft(2 * spectrum)


def test_sine_square_has_both_signs_and_leaves_the_dead_zone_out():
    r = sine_square(6.0, 100, 60, block=30, frequency=0.5, dead_zone=1.5)
    v = r["V"].reshape(2, 3, 1000)
    np.testing.assert_allclose(v[0], v[1])
    up, down, square = v[0]
    assert up.min() == pytest.approx(1.5)
    assert up.max() == pytest.approx(6.0)
    np.testing.assert_allclose(up, -down)
    t = np.arange(1000) / 100
    np.testing.assert_allclose(up, 3.75 - 2.25 * np.cos(2 * np.pi * 0.5 * t), atol=1e-12)
    assert set(square) == {-6.0, 6.0}
    assert np.sum(np.diff(square) != 0) == 9  # 5 periods of 2 s


def test_staircase_levels():
    v = staircase(6.0, 50, 34, steps=4, dead_zone=2.0)["V"]
    np.testing.assert_allclose(v[::100], [0, 3, 4, 5, 6, 5, 4, 3, 0, -3, -4, -5, -6, -5, -4, -3, 0])
    assert staircase(6.0, 50, 34, steps=4, both_signs=False)["V"].min() == 0


def test_limits_are_held_and_told():
    r = prbs(10.0, 100, 20, hold=20, seed=1)
    scaled = limited(r, voltage=9.0, duty=0.6, supply=12.0)
    np.testing.assert_allclose(scaled["V"], 0.72 * r["V"])
    assert "scaled by 0.72" in scaled.log[-1]
    clipped = limited(multisine(10.0, 100, 10), voltage=8.0, how="clip")
    assert np.max(np.abs(clipped["V"])) == 8.0
    assert "clipped" in clipped.log[-1]
    slow = limited(r, slew=200.0)
    assert np.max(np.abs(np.diff(slow["V"], prepend=0.0))) <= 2.0 + 1e-12
    assert "slew" in slow.log[-1]
    assert slow["V"].max() == 10.0  # ramps of 10 samples reach the level within a bit of 20
    assert "without a change" in limited(r, voltage=10.0).log[-1]


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: limited(prbs(6.0, 100, 10), slew=20.0), "slew of 20"),
        (lambda: limited(prbs(6.0, 100, 10), duty=1.2, supply=12), "duty is 1.2"),
        (lambda: limited(prbs(6.0, 100, 10), duty=0.9), "supply="),
        (lambda: limited(prbs(6.0, 100, 10), voltage=-1), "voltage is -1"),
        (lambda: prbs(6.0, 100), "neither duration nor order"),
        (lambda: prbs(0.0, 100, 1), "amplitude is 0.0"),
        (lambda: prbs(1.0, 100, order=40), "order is 40"),
        (lambda: multisine(1.0, 100, 1.0, high=80), "carry up to 50 Hz"),
        (lambda: multisine(1.0, 100, 1.0, low=1.2, high=1.8), "no multiple"),
        (lambda: chirp(1.0, 100, 1.0, low=2, high=2), "two frequencies"),
        (lambda: sine_square(1.0, 100, 60, dead_zone=2.0), "dead_zone is 2"),
        (lambda: staircase(1.0, 100, 0.05), "fewer than the 25 levels"),
        (lambda: prbs(1.0, 100, 1e9), "samples"),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(make, words):
    with pytest.raises(RecordingError, match=words):
        make()


def test_csv_reads_back_to_the_same_bits(tmp_path):
    made = limited(multisine(6.0, 100, 10, phases="crest"), voltage=5.0)
    read = read_csv(to_csv(made, tmp_path / "excite.csv"))
    np.testing.assert_array_equal(read["V"], made["V"])
    np.testing.assert_array_equal(read.t, made.t)
    assert read.signals["V"].unit == "V"
    assert any("crest factor" in line for line in read.log)


@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not on this machine: the C header is not compiled")
def test_c_header_compiles_and_holds_the_values(tmp_path):
    made = prbs(6.0, 100, 5, hold=3, seed=2)
    step = 12 / 255
    to_c_header(made, tmp_path / "excite.h", step=step)
    (tmp_path / "main.c").write_text(
        '#include <stdio.h>\n#include "excite.h"\nint main(void) { for (unsigned k = 0; k < EXCITE_LENGTH; k++) '
        'printf("%.17g\\n", EXCITE_STEP * excite[k]); return EXCITE_PERIOD_US != 10000u; }\n'
    )
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic"]
    subprocess.run(["gcc", *flags, "-o", tmp_path / "main", tmp_path / "main.c"], check=True, timeout=600)
    told = subprocess.run([tmp_path / "main"], check=True, capture_output=True, text=True, timeout=100).stdout
    np.testing.assert_allclose([float(line) for line in told.split()], made["V"], atol=step / 2)


def test_c_header_refuses_what_16_bits_cannot_hold(tmp_path):
    with pytest.raises(RecordingError, match="16 bits"):
        to_c_header(prbs(6.0, 100, 5), tmp_path / "a.h", step=1e-5)
    with pytest.raises(RecordingError, match="missing"):
        to_c_header(Recording(np.arange(3.0), {"V": Signal(np.array([1.0, np.nan, 2.0]), "V")}), tmp_path / "a.h")
    with pytest.raises(RecordingError, match="whole number"):
        to_c_header(prbs(6.0, 3.0, 5), tmp_path / "a.h")
