"""Where a value comes from: the grammar of ``sources:``, and what another reader might have taken instead."""

from collections.abc import Mapping
from typing import Any, Literal

from pydantic.dataclasses import dataclass

from navbench.validation import STRICT, DescriptionError, Number, describe

OPEN = ("fitted", "selected", "assumed")  # what another reader might have chosen otherwise
KINDS = ("paper", "derived", "public", "tuned", *OPEN)
VARIED = ("apply", "tie", "group", "scale")  # how a range or choices vary a value


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Source:
    """Where one value comes from: one of the kinds, with why, and what else it might be.

    Attributes:
        paper: the table, equation or section that prints it.
        derived: from what it follows.
        public: which project has it.
        tuned: how it was searched, with the ``seed``.
        fitted: to what it was fitted; ``claims`` names these claims, ``STUDY.ID`` or, of the study itself, ``ID``.
        selected: what was chosen by success in some worlds; ``worlds`` names them.
        assumed: why.
        seed: of the tuning.
        claims: what it was fitted to.
        worlds: where it was selected.
        range: between what another reader might have taken it: [low, high]; null for what is switched off.
        choices: instead of a range, what else it might be, itself included.
        apply: of a vector with a range: its values are multiplied by a number in it (``scale``), moved by one
            (``step``), or multiplied so that the one of largest size has this size (``peak``).
        tie: values, by their dotted names in the same part, that stay equal to this one.
        group: what varies together with all else of this name, such as a layout: one factor.
        scale: in which the range is sampled.
    """

    paper: str | None = None
    derived: str | None = None
    public: str | None = None
    tuned: str | None = None
    fitted: str | None = None
    selected: str | None = None
    assumed: str | None = None
    seed: int | None = None
    claims: tuple[str, ...] = ()
    worlds: tuple[str, ...] = ()
    range: tuple[Number | None, Number | None] | None = None
    choices: tuple[Any, ...] | None = None
    apply: Literal["scale", "step", "peak"] | None = None
    tie: tuple[str, ...] = ()
    group: str | None = None
    scale: Literal["linear", "log"] | None = None

    def __post_init__(self) -> None:
        """Check that it is of one kind, and that it has what belongs to it, and only that."""
        kinds = [kind for kind in KINDS if getattr(self, kind)]
        if len(kinds) != 1:
            raise DescriptionError(
                f"must have one of {', '.join(KINDS)}, with why; it has {', '.join(kinds) or 'none'}"
            )
        for word, kind in (("claims", "fitted"), ("worlds", "selected")):
            if bool(getattr(self, word)) != (kinds[0] == kind):
                raise DescriptionError(f"must have `{word}` beside `{kind}`, and only there")
        if (self.range or self.choices) and kinds[0] not in OPEN:
            raise DescriptionError(f"must have `range` or `choices` only beside {', '.join(OPEN)}")
        if self.range and self.choices:
            raise DescriptionError("must have one of `range` and `choices`, not both")
        if self.choices is not None and len(self.choices) < 2:
            raise DescriptionError(f"choices={list(self.choices)}: must be at least two")
        for word in VARIED:
            if getattr(self, word) and not (self.range or self.choices or (word == "group" and kinds[0] in OPEN)):
                raise DescriptionError(f"must have `{word}` only beside `range` or `choices`")
        low, high = self.range or (None, None)
        if low is not None and high is not None and not low < high:
            raise DescriptionError(f"range=[{low:g}, {high:g}]: the first must be below the second")
        if self.scale == "log" and not (low is not None and low > 0.0):
            raise DescriptionError("scale=log: must have a range above 0")
        if self.apply and not self.range:
            raise DescriptionError(f"apply={self.apply}: must have a range")

    @property
    def kind(self) -> str:
        """Which kind it is of."""
        return next(kind for kind in KINDS if getattr(self, kind))


def check_sources(part: str, sources: Mapping[str, Mapping[str, Any]]) -> None:
    """Check the sources of a part's values.

    Args:
        part: such as "controller", for the error message.
        sources: the source of each value, by its dotted name.

    Raises:
        DescriptionError: one line that names the first wrong source.
    """
    for name, source in sources.items():
        describe(Source, source, f"{part}.sources.{name}")
