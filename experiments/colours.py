"""Colours that the figures of the experiments share with all others."""

from gazempc.results.figures.style import COLOURS

__all__ = ["COLOURS"]
