"""Low-pass filtering."""

from plantfit.recording.clean.butterworth import smooth
from plantfit.recording.clean.cutoff import CutoffRule, resolve_cutoff
from plantfit.recording.clean.sampling import lost, signal_of, uniform_period, with_signal
from plantfit.recording.record import Recording


def lowpass(
    recording: Recording,
    name: str,
    cutoff: float | CutoffRule,
    order: int = 2,
    causal: bool = False,
    noise: float | None = None,
) -> Recording:
    """Butterworth low-pass at `cutoff` Hz; zero-phase (forwards and backwards) unless `causal`.

    `cutoff` may name a rule of `cutoff_frequency`, with its `noise`.
    A causal filter delays the signal and halves the power at the cutoff; the zero-phase one does
    not delay and halves the amplitude there. Stretches between missing samples are filtered apart.
    Raises RecordingError for a cutoff at or above half the sampling rate, and for uneven steps.
    """
    signal = signal_of(recording, name)
    period = uniform_period(recording, f"lowpass({name!r})")
    cutoff, why = resolve_cutoff(recording, name, cutoff, order, noise)
    values = smooth(signal.values, period, cutoff, order, causal, f"lowpass({name!r})")
    kind = "causal" if causal else "zero-phase"
    sentence = (
        f"All {len(values)} samples of {name!r} low-pass filtered ({kind} Butterworth, order {order}, {cutoff:.4g} Hz)"
    )
    return with_signal(recording, name, values, signal.unit, f"{sentence}{lost(signal.values, values)}.{why}")
