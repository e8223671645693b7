"""orip: bundle adjustment of ORIPROGRAM-style project folders."""

__version__ = "0.1.0"
