"""The demos: real recordings that come with plantfit, each with study files and a small driver."""

from plantfit.cases.registry import demos

__all__ = ["demos"]
