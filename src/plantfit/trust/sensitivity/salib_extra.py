"""SALib is installed only where sensitivity is asked for: it brings pandas and matplotlib."""

from importlib.util import find_spec

from plantfit.errors import MissingExtra

MISSING = "needs the package SALib; install it with: pip install 'plantfit[trust]'"


def has_salib() -> bool:
    """Whether SALib is installed."""
    return find_spec("SALib") is not None


def need_salib() -> None:
    """Raise MissingExtra where SALib is not installed."""
    if not has_salib():
        raise MissingExtra(f"Sensitivity {MISSING}")
