"""Factors: what another reader might have chosen, from sources to values."""

from typing import Any

import pytest
from stored import a_cell

from navbench.analysis.factors import apply, factors_of
from navbench.cli.configuration import compose_cell
from navbench.validation import DescriptionError


def values_at(u: float, value: Any, **source: Any) -> dict[str, Any]:
    """Return what the one factor of a controller's value sets."""
    cell = a_cell(of=value)._replace(sources={"controller": {"build.of": {"assumed": "why", **source}}})
    (factor,) = factors_of([cell])
    return apply(factor, u, cell.configuration)


@pytest.mark.parametrize(
    ("value", "source", "expected"),
    [
        (1.0, {"range": [1.0, 3.0]}, 1.5),
        (1.0, {"range": [1.0, 16.0], "scale": "log"}, 2.0),
        (2, {"range": [1, 9]}, 3),
        ("safe", {"choices": ["safe", "literal", "sides"]}, "safe"),
        (None, {"range": [None, 10.0]}, None),
        ([1.0, -2.0], {"range": [1.0, 3.0], "apply": "scale"}, [1.5, -3.0]),
        ([1.0, -2.0], {"range": [1.0, 3.0], "apply": "step"}, [2.5, -0.5]),
        ([1.0, -2.0], {"range": [1.0, 3.0], "apply": "peak"}, [0.75, -1.5]),
    ],
)
def test_a_quarter_of_the_range_moves_a_value_as_its_source_says(
    value: Any, source: dict[str, Any], expected: Any
) -> None:
    found = values_at(0.25, value, **source)
    assert list(found) == ["controller.build.of"]
    assert found["controller.build.of"] == (pytest.approx(expected) if isinstance(expected, float) else expected)


def test_the_values_of_a_mapping_are_set_each_under_its_own_name() -> None:
    found = values_at(1.0, {"S": 0.0, "L": {"l": 1.0, "r": -2.0}}, range=[0.5, 4.0], apply="peak")
    assert found == {
        "controller.build.of.S": 0.0,
        "controller.build.of.L.l": 2.0,
        "controller.build.of.L.r": -4.0,
    }


def test_the_ends_of_choices_are_reached_and_ties_follow() -> None:
    source = {"choices": [1.0, 2.0], "tie": ["build.kp"]}
    assert values_at(0.0, 1.0, **source) == {"controller.build.of": 1.0, "controller.build.kp": 1.0}
    assert values_at(1.0, 1.0, **source) == {"controller.build.of": 2.0, "controller.build.kp": 2.0}
    with pytest.raises(ValueError, match=r"u must be in \[0, 1\]"):
        values_at(1.1, 1.0, **source)


def test_a_group_is_one_factor_of_its_thing() -> None:
    source = {"assumed": "why", "choices": [[1], [2]], "group": "layout"}
    sources = {"world": {"boxes": source, "starts": {**source, "choices": [[3], [4]]}}}
    cells = [a_cell("A", world)._replace(sources=sources) for world in ("plain", "other", "plain")]
    first, second = factors_of(cells)
    assert (first.name, second.name, first.things) == ("plain.layout", "other.layout", ("plain",))
    assert apply(first, 0.9, cells[0].configuration) == {"world.boxes": [2], "world.starts": [4]}


def test_a_range_beside_a_vector_without_a_word_on_how_is_refused() -> None:
    with pytest.raises(DescriptionError, match="controller.sources.build.of: must have `apply`, one of scale, step"):
        values_at(0.5, [1.0], range=[1.0, 2.0])


def test_a_composed_cell_names_its_factors_with_kinds_and_bounds() -> None:
    cell = compose_cell("controller=dual_layer", "world=lei_swap", "sensors=disc_tracker").key()
    found = {factor.name: (factor.kind, factor.bounds) for factor in factors_of([cell])}
    assert found["dual_layer.turn_max_radps"] == ("selected", (0.1, 1.0))
    assert found["tracked.body"] == ("assumed", (0.15, 0.35))
    assert found["tracked.wheel_accel_max_mps2"] == ("assumed", (None, 1.0))
    assert "dual_layer.speed_max_mps" not in found
