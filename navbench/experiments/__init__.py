"""Experiments: many episodes, as cells, tunings and studies, and where they are kept."""
