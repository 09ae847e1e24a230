"""A constructor that checks its arguments: one line that names the first wrong one, and a call like any other."""

from typing import Any

import pytest

from navbench.validation import Count, DescriptionError, Positive, checked


class Thing:
    @checked("build")
    def __init__(self, *, length_m: Positive, count: Count) -> None:
        self.area = length_m * count


def test_checked_arguments_make_the_object() -> None:
    assert Thing(length_m=0.5, count=3).area == 1.5


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"length_m": -0.5, "count": 3}, "build.length_m=-0.5: must be greater than 0"),
        ({"length_m": 0.5, "count": 1.5}, "build.count=1.5: must be a whole number"),
        ({"length_m": 0.5}, "build.count: missing; a value is needed"),
        (
            {"length_m": 0.5, "count": 3, "lenght_m": 0.5},
            "build.lenght_m: unknown key; did you mean length_m? allowed here: length_m, count",
        ),
    ],
)
def test_the_first_wrong_argument_is_named(given: dict[str, Any], said: str) -> None:
    with pytest.raises(DescriptionError) as caught:
        Thing(**given)
    assert str(caught.value) == said
