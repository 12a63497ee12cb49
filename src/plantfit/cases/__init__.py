"""The demos: real recordings that come with plantfit, each with study files and a small driver."""

from plantfit.cases.shared.registry import demos

__all__ = ["demos"]
