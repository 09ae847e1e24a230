"""The picture of a controller: its fuzzy sets, control surfaces and rules, its ring, and its parameters."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from navbench.fuzzy.describing import membership_corners
from navbench.fuzzy.inference import FuzzyInference, memberships
from navbench.fuzzy.variables import ANY, Variable
from navbench.report.bodies import ring_block
from navbench.report.described import draw_sets, draw_surface
from navbench.report.figures import PALETTE, Block, stacked
from navbench.robot import Robot
from navbench.sensors import Sensors

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Draw = Callable[["Axes"], None]
FloatArray = NDArray[np.float64]

POINTS, SIDE = 401, 41  # of a curve, and along each side of a surface
TERMS = 7  # of a variable; with more only two stand side by side
ANSWER_INCHES, ROW_INCHES, LINE_INCHES = 2.6, 0.2, 0.15  # a surface, a row of a rule grid, a line of text
DEEP = 2  # attributes of attributes of a controller are looked through
TINTS = 0.55  # how far a rule's colour is from white


def draw_controller(
    title: str, controller: object, robot: Robot, sensors: Sensors, parameters: Sequence[tuple[str, str, str]]
) -> "Figure":
    """Return the picture of a controller.

    Args:
        title: what stands above it.
        controller: the controller; what it holds of ``FuzzyInference`` is drawn, or else what it describes.
        robot: its robot.
        sensors: its sensors, as drawn.
        parameters: each parameter's name, its value, and where it comes from; listed where nothing is fuzzy.
    """
    parts = dict(fuzzy_parts(controller))
    blocks = [block for name, part in parts.items() for block in _blocks_of(name, part)]
    if not parts and hasattr(controller, "describe"):
        blocks += _described_blocks(controller.describe())
    blocks.append(ring_block(sensors.scaled_to(robot.radius_m), robot.track_m))
    if not parts and parameters:
        blocks.append(
            Block("Parameters", [partial(draw_table, rows=parameters)], 1, LINE_INCHES * (len(parameters) + 2))
        )
    return stacked(title, blocks)


def fuzzy_parts(thing: object, name: str = "", depth: int = 0) -> Iterator[tuple[str, FuzzyInference]]:
    """Yield the rule bases that an object holds, each with the name of its attribute."""
    if isinstance(thing, FuzzyInference):
        yield name, thing
    elif depth < DEEP:
        for inner, value in getattr(thing, "__dict__", {}).items():
            yield from fuzzy_parts(value, inner.strip("_"), depth + 1)


def _blocks_of(name: str, part: FuzzyInference) -> list[Block]:
    called = name.replace("_", " ")
    variables = _distinct({**part.inputs, **part.outputs})
    sets: list[Draw] = [partial(_draw_variable, title=title, variable=one) for title, one in variables.items()]
    answers: list[Draw] = []
    for output in range(len(part.outputs)):
        answers += [partial(_draw_output, part=part, output=output), partial(draw_rules, part=part, output=output)]
    columns = 2 if max(len(one.terms) for one in variables.values()) > TERMS else 3
    held = f", with {' and '.join([*part.inputs][2:])} in the middle" if len(part.inputs) > 2 else ""
    height = max(ANSWER_INCHES, 0.8 + ROW_INCHES * len(_premises(part)[0]))
    return [
        Block(f"{called}: fuzzy sets", sets, min(columns, len(sets)), 1.9),
        Block(f"{called}: control surface{held}, and rules", answers, 2, height),
    ]


def _described_blocks(tables: Mapping[str, Mapping[str, Sequence[Any]]]) -> list[Block]:
    """Return the fuzzy sets and the rules that a controller tells of itself without a ``FuzzyInference``."""
    import pandas as pd

    blocks = []
    for name, columns in tables.items():
        table = pd.DataFrame(dict(columns))
        if {"variable", "term", "x", "degree"} <= {*columns}:
            sets: list[Draw] = []
            for variable, of in table.groupby("variable", sort=False):
                axis = {"title": variable, "low": of["x"].min(), "high": of["x"].max()}
                sets.append(partial(draw_sets, sets=of, axis=axis))
            blocks.append(Block(name, sets, min(2, len(sets)), 1.9))
        elif len(table) and all(isinstance(word, str) for word in table.to_numpy().ravel()):
            rows = [list(table.columns), *table.to_numpy().tolist()]
            blocks.append(Block(name, [partial(draw_table, rows=rows)], 1, LINE_INCHES * (len(rows) + 2)))
    return blocks


def _distinct(variables: Mapping[str, Variable]) -> dict[str, Variable]:
    """Return variables by their names, those that are equal once, under all their names."""
    names: dict[str, Variable] = {}
    for name, variable in variables.items():
        same = next((title for title, other in names.items() if other == variable), None)
        if same is None:
            names[name] = variable
        else:
            names = {f"{title}, {name}" if title == same else title: one for title, one in names.items()}
    return names


def _draw_variable(ax: "Axes", title: str, variable: Variable) -> None:
    """Draw a variable's sets: by their corners where they go round a circle, else as they are within its range."""
    import pandas as pd

    axis = {"title": title, "low": variable.low, "high": variable.high, "circle": variable.circular}
    if variable.circular:
        sets = pd.DataFrame(membership_corners({title: variable}))
    else:
        corners = [x for term in variable.terms.values() for x in term.corners if variable.low < x < variable.high]
        x = np.unique([*np.linspace(variable.low, variable.high, POINTS), *corners])
        columns = {term: of for term, of in zip(variable.terms, memberships(variable, x), strict=True)}
        sets = pd.DataFrame({"x": x, **columns}).melt("x", var_name="term", value_name="degree")
    draw_sets(ax, sets, axis)


def _draw_output(ax: "Axes", part: FuzzyInference, output: int) -> None:
    """Draw one output over the first two inputs, or over the only one; all others are in the middle of their ranges."""
    names, label = list(part.inputs), list(part.outputs)[output]
    count = POINTS if len(names) == 1 else SIDE
    axes = [np.linspace(one.low, one.high, count if i < 2 else 1) for i, one in enumerate(part.inputs.values())]
    axes[2:] = [np.array([0.5 * (one.low + one.high)]) for one in list(part.inputs.values())[2:]]
    values = part.surface(*axes)[..., output].reshape([len(axis) for axis in axes[:2]])
    if len(names) == 1:
        ax.plot(axes[0], values, color=PALETTE[0])
        ax.grid(alpha=0.3)
        ax.set(xlabel=names[0], ylabel=label, xlim=(axes[0][0], axes[0][-1]))
    else:
        draw_surface(ax, axes[0], axes[1], values.T, label)
        ax.set(xlabel=names[0], ylabel=names[1])


def _premises(part: FuzzyInference) -> tuple[list[tuple[str, ...]], list[tuple[str, ...]]]:
    """Return the premises of a rule base's rows and columns: the first half of its inputs, and the second half."""
    split, count = (len(part.inputs) + 1) // 2, len(part.inputs)
    return [*dict.fromkeys(rule[:split] for rule in part.rules)], [
        *dict.fromkeys(rule[split:count] for rule in part.rules)
    ]


def draw_rules(ax: "Axes", part: FuzzyInference, output: int) -> None:
    """Draw what the rules conclude on one output as a grid, a colour a term."""
    from matplotlib import colormaps

    rows, columns = _premises(part)
    names, label = list(part.inputs), list(part.outputs)[output]
    split, terms = len(rows[0]), list(part.outputs[label].terms)
    shades = 1.0 - TINTS * (1.0 - colormaps["coolwarm"](np.linspace(0.0, 1.0, len(terms)))[:, :3])
    picture = np.ones((len(rows), len(columns), 3))
    for rule in part.rules:
        row, column = rows.index(rule[:split]), columns.index(rule[split : len(names)])
        term = rule[len(names) + output]
        if term in terms:
            picture[row, column] = shades[terms.index(term)]
        ax.text(column, row, term, ha="center", va="center", fontsize=8)
    ax.imshow(picture, aspect="auto", interpolation="none")
    ax.set_xticks(range(len(columns)), [_premise(one) for one in columns], fontsize=8)
    ax.set_yticks(range(len(rows)), [_premise(one) for one in rows], fontsize=8)
    ax.set(xlabel=", ".join(names[split:]), ylabel=", ".join(names[:split]))
    ax.set_title(label, fontsize=9)
    ax.tick_params(length=0)


def _premise(terms: Sequence[str]) -> str:
    return " ".join("*" if term == ANY else term for term in terms)


def draw_table(ax: "Axes", rows: Sequence[Sequence[str]]) -> None:
    """Write rows of words below each other, the first column in front."""
    ax.set_axis_off()
    for i, row in enumerate(rows):
        y = 1.0 - (i + 0.5) / len(rows)
        for j, word in enumerate(row):
            ax.text(j / len(row), y, word, transform=ax.transAxes, fontsize=8, va="center", parse_math=False)
