"""Checks of the elements of a machine, and access to their parameters by name."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from dynkit.systems.impact.elements.element import IMPACT, Element
from dynkit.systems.impact.elements.friction import DryFriction
from dynkit.systems.impact.elements.laws import ImpactLaw
from dynkit.systems.impact.elements.stops import HardStop, SoftStop


def checked_elements(given: Any, size: int) -> tuple[Element, ...]:
    """Return checked elements for a structure of N coordinates; ValueError for invalid ones."""
    if isinstance(given, Element) or not isinstance(given, Iterable):
        raise ValueError(f"elements must be a sequence of elements; got {given!r}")
    elements = tuple(given)
    if not elements:
        raise ValueError(
            "elements must hold one element at least; got none: a SoftStop out of reach leaves the "
            "structure alone"
        )
    for k, element in enumerate(elements):
        if not isinstance(element, Element):
            raise ValueError(f"elements[{k}] must be an element like HardStop; got {element!r}")
        hits = any(watch.event == IMPACT for regime in element.regimes for watch in regime.guards)
        holds = any(r.holds for r in element.regimes) and not isinstance(element, SoftStop)
        if (hits or holds) and not isinstance(element, HardStop):
            raise ValueError(
                f"elements[{k}] must not be hit, nor hold, which is for HardStop; got {element!r}"
            )
        if element.slider and not element.regimes[0].anchored:
            raise ValueError(
                f"elements[{k}] must stick in its first regime, as it does in one; got {element!r}"
            )
    names = [element.name for element in elements if element.name]
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"elements must have different names; got {name!r} twice")
    found = tuple(element.of(size, f"elements[{k}]") for k, element in enumerate(elements))
    for k, element in enumerate(found):
        if element.leans_on or any(regime.traction for regime in element.regimes):
            _check_normal(found, k, size)
    return found


def check_curved(owner: object, elements: tuple[Element, ...]) -> None:
    """Raise ValueError if a named function of the coordinates is not a method of the oscillator."""
    for k, element in enumerate(elements):
        if element.curved and not callable(getattr(owner, element.coordinate, None)):
            raise ValueError(
                f"elements[{k}].coordinate must be the name of a method of the oscillator; "
                f"got {element.coordinate!r}"
            )


def _check_normal(elements: tuple[Element, ...], k: int, size: int) -> None:
    """Check the normal of friction; ValueError if invalid, NotImplementedError if unsupported."""
    own, names = elements[k], names_of(elements)
    if not isinstance(own, DryFriction):
        raise ValueError(
            f"elements[{k}] must not lean on others, which is for DryFriction; got {own!r}"
        )
    stops = [n for n, e in zip(names, elements, strict=True) if isinstance(e, HardStop)]
    if own.leans_on not in stops:
        raise ValueError(
            f"elements[{k}].normal must be the name of a hard stop, one of {stops}; "
            f"got {own.leans_on!r}"
        )
    stop = elements[names.index(own.leans_on)]
    if isinstance(getattr(stop, "restitution", None), ImpactLaw):
        raise NotImplementedError(
            f"elements[{k}].normal must be a stop whose restitution is a number; got {stop!r}"
        )
    for other in elements[:k] + elements[k + 1 :]:
        if isinstance(other, HardStop | DryFriction) and other.curved is own.curved:
            rows = [own.row(size), other.row(size)]
            alike = np.linalg.matrix_rank(np.array(rows)) < 2
            if own.coordinate == other.coordinate if own.curved else alike:
                raise NotImplementedError(
                    f"elements[{k}], friction with a coefficient, must not act along a hard stop "
                    f"or along other friction; got {other!r}"
                )


def names_of(elements: tuple[Element, ...]) -> list[str]:
    """Names of elements; ``elements[k]`` for an element without a name."""
    return [element.name or f"elements[{k}]" for k, element in enumerate(elements)]


def numbers_of(elements: tuple[Element, ...]) -> dict[str, float]:
    """Parameters of all elements, by names such as ``table.offset``."""
    found: dict[str, float] = {}
    for name, element in zip(names_of(elements), elements, strict=True):
        for entry in dataclasses.fields(element):
            found |= numbers_in(f"{name}.{entry.name}", getattr(element, entry.name))
    return found


def numbers_in(name: str, value: object) -> dict[str, float]:
    """Parameters in one field: the number itself, the numbers of an impact law, or none."""
    if isinstance(value, float):
        return {name: value}
    if isinstance(value, ImpactLaw):
        return {f"{name}.{own}": number for own, number in value.numbers.items()}
    return {}


def with_law(name: str, law: object, given: Mapping[str, Any]) -> dict[str, Any]:
    """Given fields; entries ``name.number`` are replaced by a law ``name`` with these numbers."""
    start = f"{name}."
    own = {n.removeprefix(start): v for n, v in given.items() if n.startswith(start)}
    if not own:
        return dict(given)
    others = {n: v for n, v in given.items() if not n.startswith(start)}
    return others | {name: replace(given.get(name, law), **own)}


def laws_of(elements: tuple[Element, ...]) -> list[str]:
    """Names of the fields that hold an impact law, such as ``table.restitution``."""
    return [
        f"{name}.restitution"
        for name, element in zip(names_of(elements), elements, strict=True)
        if isinstance(getattr(element, "restitution", None), ImpactLaw)
    ]


def with_numbers(elements: tuple[Element, ...], given: Mapping[str, Any]) -> tuple[Element, ...]:
    """The elements with new values of some parameters, named as in `numbers_of` and `laws_of`."""
    found = list(elements)
    for k, name in enumerate(names_of(elements)):
        start = f"{name}."
        own = {n.removeprefix(start): v for n, v in given.items() if n.startswith(start)}
        if own:
            law = getattr(elements[k], "restitution", None)
            found[k] = replace(elements[k], **with_law("restitution", law, own))
    return tuple(found)
