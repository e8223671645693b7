"""COLMAP: sparse models as text and binary, with or without rigs and frames, and pose priors of its database."""
