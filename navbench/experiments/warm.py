"""Importing this readies numba, which takes as long as many episodes: workers are forked from a process that did so."""

from contextlib import suppress

from navbench.mathematics.kinematics import advance_arc

with suppress(Exception):  # what fails here is said where it is needed
    advance_arc(0.0, 0.0, 0.0, 0.1, 0.1, 0.05)
