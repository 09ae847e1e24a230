"""What a study says of its multiverse: which reconstructions count as its paper's, and which numbers condition them."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import field
from typing import Any

from pydantic.dataclasses import dataclass

from navbench.analysis.claims import Claim, Entry
from navbench.analysis.factors import Factor
from navbench.analysis.measuring import check_measure
from navbench.validation import STRICT, DescriptionError, Number, describe, instead

KIND = "admissible"  # of the entries that say which reconstructions count


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Conditioned:
    """Printed numbers that a reconstruction meets, by rejection.

    Attributes:
        claims: the claims that print them.
        within: how near each must be, such as ``10 %``.
        leave_out: further claims that follow from these, and are not told under the condition.
    """

    claims: tuple[str, ...]
    within: str
    leave_out: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, config=STRICT)
class Multiverse:
    """What a study says of its multiverse.

    Attributes:
        admissible: what a reconstruction must do to count as one of the paper, in the form of claims that hold.
        implied: the claims that follow from that, whose shares are told over all reconstructions only.
        conditioned: on which printed numbers, or None.
        together: the claims whose printed numbers are independent of each other, and are fitted together; None for
            all that print one.
        free: the factors, by name, whose value some cells set only to name the reading that the study takes, with the
            labels of these cells: there they are drawn all the same. What other cells set is their purpose, and stays.
        priors: other priors by name: the factors that move, each with the range of its values of a range; null for as
            they are. Every other value stays as the study has it.
    """

    admissible: Mapping[str, Mapping[str, Any]]
    implied: tuple[str, ...] = ()
    conditioned: Conditioned | None = None
    together: tuple[str, ...] | None = None
    free: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    priors: Mapping[str, Mapping[str, tuple[Number | None, Number | None] | None]] = field(default_factory=dict)


def multiverse_of(study: Mapping[str, Any], claims: Sequence[Entry]) -> Multiverse:
    """Return what a study says of its multiverse, checked.

    Args:
        study: its name and its ``multiverse`` as plain values.
        claims: its claims.

    Raises:
        DescriptionError: it says nothing, or a value is wrong; the message names it.
    """
    key = f"study/{study['name']}.multiverse"
    if not study.get("multiverse"):
        raise DescriptionError(f"{key}: missing; it says which reconstructions are admissible")
    found = describe(Multiverse, study["multiverse"], key)
    known = [entry.name for entry in claims]
    conditioned = found.conditioned or Conditioned(claims=(), within="0 %")
    named = {"implied": found.implied, "together": found.together or (), "conditioned.claims": conditioned.claims}
    for word, names in {**named, "conditioned.leave_out": conditioned.leave_out}.items():
        for name in names:
            if name not in known:
                raise DescriptionError(f"{key}.{word}={name}: no such claim; {instead(name, known)}")
    return found


def check_free(multiverse: Multiverse, factors: Iterable[Factor], labels: Collection[str], key: str) -> None:
    """Check that what is to be drawn although cells set it is a factor, and that there are such cells.

    Raises:
        DescriptionError: one of them is not there.
    """
    known = [factor.name for factor in factors]
    for name, of in multiverse.free.items():
        if name not in known:
            raise DescriptionError(f"{key}.{name}: no such factor; {instead(name, known)}")
        for label in of:
            if label not in labels:
                raise DescriptionError(f"{key}.{name}={label}: no cell has this label; {instead(label, labels)}")


def conditions(study: Mapping[str, Any], multiverse: Multiverse) -> list[Entry]:
    """Return what makes a reconstruction admissible, as entries beside the claims.

    Raises:
        DescriptionError: one of them is no statement with a measure.
    """
    found = []
    for name, values in multiverse.admissible.items():
        key = f"study/{study['name']}.multiverse.admissible.{name}"
        claim = describe(Claim, dict(values), key)
        if claim.measure is None or claim.share is None:
            raise DescriptionError(f"{key}: must have a measure, and hold in a share of the cases")
        check_measure(f"{key}.measure", claim.measure, claim.of or {}, trust=True)
        found.append(Entry(f"{KIND}.{name}", KIND, claim))
    return found
