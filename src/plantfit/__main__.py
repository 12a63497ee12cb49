"""`python -m plantfit`: the same as `plantfit`."""

from plantfit.cli.start import run

if __name__ == "__main__":
    run()
