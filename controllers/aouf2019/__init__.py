"""Aouf, Boussaid and Sakly 2019: S.F.L.C., the PID that it is compared with, and mixtures of the two."""
