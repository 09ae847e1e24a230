"""What stands below the picture of an episode, over the time: speeds, turning rates, and a controller's trace."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from navbench.experiments.rows import RANGES, TRAJECTORY
from navbench.report.drives import ACTIVE, BANDS, FEW, Drive
from navbench.report.figures import PALETTE
from navbench.report.trajectories import stairs, widen_flat
from navbench.report.wheels import spans_of

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

UNITS = {"_m": "m", "_rad": "degrees", "_mps": "m/s", "_radps": "degrees/s", "_s": "s", "_mps2": "m/s²"}
FLAGS, UNIT_RANGE = "0 or 1", "-1 to 1"  # what columns without a unit have in common
STRIP_INCHES, MORE_INCHES, FITTING = 0.95, 0.06, 5  # a strip, and for each line that fits its legend no more


def draw_velocities(v: "Axes", w: "Axes", shown: Sequence[Drive], told: Drive) -> None:
    """Draw all robots' speeds and turning rates, that of which the trace is told in front."""
    for drive in shown:
        front = drive is told
        color = drive.color if front or len(shown) <= FEW else "0.8"
        look = {"color": color, "linewidth": 1.3 if front else 0.7, "zorder": 3 if front else 2}
        for ax, name in ((v, "v_mps"), (w, "w_radps")):
            stairs(ax, drive.path["t_s"].to_numpy(), drive.path[name].to_numpy(dtype=float), drive.name, look)
    for ax, label in ((v, "v [m/s]"), (w, "w [rad/s]")):
        ax.set_ylabel(label, fontsize=8)
        _finish_strip(ax, told)
    if 1 < len(shown) <= FEW and v.lines:
        v.legend(loc="upper left", bbox_to_anchor=(1.0, 1.05), frameon=False, fontsize=8)


def trace_groups(path: "pd.DataFrame") -> dict[str, list[str]]:
    """Return the columns of a trace that share an axis, by its title.

    Those that are always 0 or 1 share one; so do those of one unit, and those without a unit that stay within -1 and 1;
    each other one has its own. Those that tell which behaviour is active are left out.
    """
    own = [name for name in path.columns if name not in TRAJECTORY]
    own = [name for name in own if not name.startswith(ACTIVE)]
    groups: dict[str, list[str]] = {}
    for name in own:
        values = path[name].dropna()
        if values.empty:
            continue
        unit = next((unit for end, unit in UNITS.items() if name.endswith(end)), None)
        if unit is None and values.isin([0.0, 1.0]).all():
            title = FLAGS
        elif unit is None:
            title = UNIT_RANGE if values.abs().max() <= 1.0 else name
        else:
            title = f"[{unit}]"
        groups.setdefault(title, []).append(name)
    return dict(sorted(groups.items(), key=lambda group: group[0] != FLAGS))


def strip_height(columns: Sequence[str]) -> float:
    """Return how high the strip of some columns is [inches], so that their legend fits."""
    return STRIP_INCHES + MORE_INCHES * max(0, len(columns) - FITTING)


def draw_trace(ax: "Axes", told: Drive, title: str, columns: Sequence[str]) -> None:
    """Draw some columns of a trace: what is 0 or 1 as bars, all else held over its control periods."""
    t_s = told.path["t_s"].to_numpy()
    if title == FLAGS:
        for row, name in enumerate(columns):
            spans = [(begin, end - begin) for begin, end in spans_of(told.path, name)]
            ax.broken_barh(spans, (row - 0.35, 0.7), color=PALETTE[row % len(PALETTE)])
        ax.set_yticks(range(len(columns)), [name.replace("_", " ") for name in columns], fontsize=7)
        ax.set_ylim(len(columns) - 0.4, -0.6)
    else:
        for color, name in zip(PALETTE, columns, strict=False):
            values = told.path[name].to_numpy(dtype=float)
            shown = np.degrees(values) if name.endswith(("_rad", "_radps")) else values
            called = name.removesuffix("_rad").removesuffix("_radps")  # which are drawn in degrees
            stairs(ax, t_s, shown, called, {"color": color, "linewidth": 1.0})
        ax.set_ylabel("" if title == columns[0] else title, fontsize=8)
        ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.05), frameon=False, fontsize=7)
    _finish_strip(ax, told)


def readings_of(path: "pd.DataFrame") -> NDArray[np.float64]:
    """Return (n, n_sensors) what the range sensors read [m], as far as that is kept: else (0, 0)."""
    kept = path[RANGES].dropna() if RANGES in path.columns else ()
    return np.stack(list(kept)) if len(kept) else np.empty((0, 0))


def draw_ranges(ax: "Axes", told: Drive) -> None:
    """Draw what the range sensors read, a row a sensor, in the suite's order from below."""
    readings, t_s = readings_of(told.path), told.path["t_s"].to_numpy()
    edges = np.append(t_s, t_s[-1])[: len(readings) + 1]  # what raised has no state at its end
    mesh = ax.pcolormesh(edges, np.arange(readings.shape[1] + 1) - 0.5, readings.T, cmap="magma", rasterized=True)
    bar = ax.figure.colorbar(mesh, cax=ax.inset_axes((1.015, 0.0, 0.012, 1.0)))
    bar.set_label("range read [m]", fontsize=8)
    bar.ax.tick_params(labelsize=7)
    ax.set_ylabel("sensor", fontsize=8)
    ax.tick_params(labelsize=8)


def _finish_strip(ax: "Axes", told: Drive) -> None:
    """Shade a strip where behaviours are active, and give it a grid."""
    for color, name in zip(BANDS, [name for name in told.path.columns if name.startswith(ACTIVE)], strict=False):
        for begin_s, end_s in spans_of(told.path, name):
            ax.axvspan(begin_s, end_s, color=color, alpha=0.35, linewidth=0.0, zorder=0)
    widen_flat([ax])
    ax.grid(alpha=0.3)
    ax.tick_params(labelsize=8)
