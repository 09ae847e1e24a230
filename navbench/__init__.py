"""Compare reactive navigation controllers of wheeled robots in PyBullet worlds."""

__version__ = "0.1.0"
