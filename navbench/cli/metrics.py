"""Metrics of one's own: the functions that a configuration names, beside those that are always measured."""

from collections.abc import Sequence

from navbench.analysis.resolving import resolve
from navbench.analysis.stored import SELECTABLE
from navbench.metrics import METRICS, MetricFunction, declared
from navbench.records import CellKey, RobotRecord
from navbench.report.tables import COLUMNS
from navbench.validation import DescriptionError, instead

TAKEN = {*SELECTABLE, *CellKey._fields, *RobotRecord._fields, *COLUMNS, "hit_index", "layout_id", "planned", "success"}


def metrics_of(names: Sequence[str]) -> tuple[MetricFunction, ...]:
    """Return all metrics of a cell.

    Args:
        names: those beside navbench's own, as module.function.

    Raises:
        DescriptionError: one names no metric, or a metric's name is taken.
    """
    metrics = list(METRICS)
    for i, name in enumerate(names):
        key = f"metrics[{i}]"
        if "." not in name:
            always = instead(name, [metric.name for metric in declared(METRICS)], "always measured")
            raise DescriptionError(f"{key}={name}: must name a metric of your own as module.function; {always}")
        found = resolve(key, name, "", trust=True)
        if not hasattr(found, "metric"):
            raise DescriptionError(f"{key}={name}: is no metric; declare it with @metric of navbench.metrics")
        own = found.metric.name
        if own in TAKEN or own in {metric.name for metric in declared(metrics)}:
            raise DescriptionError(f"{key}={name}: its name {own} is taken; give it another one")
        metrics.append(found)
    return tuple(metrics)
