"""What an answer is: right ones are right however they are written, 2 % is never right, and known mistakes have names."""

from __future__ import annotations

import random
from functools import cache

import numpy as np
import pytest

from ctlabs.course.asked import THREE_DIGITS, AskedValue
from ctlabs.course.convention import confused, scales
from ctlabs.course.key import key
from ctlabs.course.marking import Kind, ValueMark, mark
from ctlabs.course.units import coherent, unit
from ctlabs.course.values import answer
from ctlabs.labs.catalogue import catalogue, load
from tests.course.test_answers_read import spelled

LABS = tuple(catalogue())
#: Units a person may write for an asked one.
OTHERS = {
    "m²": ("cm²", "мм²", "m^2", "км²"), "m": ("cm", "м", "mm"), "s": ("ms", "min", "мс"), "1/s": ("1/ms", "s^-1", "Hz"),
    "m²/s": ("см²/с", "m2/s"),
    "m²/s²": ("(cm/s)²", "cm^2/s^2"), "V²": ("mV²", "В^2"), "%": ("%",), "1": ("%",), "m/s": ("km/h", "см/с"), "1/m²": ("1/cm²",),
    "rad²": ("mrad²", "deg^2"), "1/s²": ("s⁻²",), "m²/s⁴": ("cm²/s⁴",),
}  # fmt: skip


@cache
def asked(lab: str) -> tuple[AskedValue, ...]:
    return key(lab, load(catalogue()[lab]).Parameters())


def marked(value: AskedValue, text: str) -> ValueMark:
    return mark(value, answer(text, value.value.shape, verdict=value.value.dtype == bool))


def written(value: AskedValue, numbers: np.ndarray, rng: random.Random) -> str:
    """Numbers as a person writes them, rounded to three significant digits, in a unit of theirs, or with rows for columns in a table."""
    told = ""
    if value.relative and value.unit in OTHERS and rng.random() < 0.5 and np.any(numbers):
        told = rng.choice(OTHERS[value.unit])
        wanted = coherent(value.unit)
        assert wanted is not None
        numbers = numbers * (wanted.factor / unit(told).factor)
    if numbers.ndim == 2 and numbers.shape[0] != numbers.shape[1] and rng.random() < 0.3:
        numbers = numbers.T
    rows = numbers.reshape(-1, numbers.shape[-1]) if numbers.ndim else numbers.reshape(1, 1)
    between, below = rng.choice([("; ", "\n"), (" ", "\n"), (", ", "\n"), (" ", ";\n")])
    count = not value.relative
    plain = [[f"{x:.0f}" if count else "0" if x == 0 else spelled(x, rng).replace(" ", "") for x in row] for row in rows.tolist()]
    if any("," in x for row in plain for x in row) and any("." in x for row in plain for x in row):
        plain = [[x.replace(",", ".") for x in row] for row in plain]  # one mark in one answer
    text = below.join(between.join(row) for row in plain)
    return f"[{text}] {told}" if told and numbers.ndim else f"{text} {told}".strip()


@pytest.mark.parametrize("lab", LABS)
def test_no_right_answer_is_called_wrong(lab: str) -> None:
    """Ten thousand answers over all labs."""
    rng = random.Random(lab)
    values = asked(lab)
    for _ in range(-(-10_000 // len(LABS) // len(values))):
        for value in values:
            text = written(value, value.value, rng)
            found = marked(value, text)
            assert found.kind == Kind.RIGHT, (value.name, value.value.tolist(), text, found.words)


@pytest.mark.parametrize("lab", LABS)
def test_an_error_of_two_per_cent_is_never_right(lab: str) -> None:
    rng = random.Random(f"{lab} wrong")
    for value in asked(lab):
        if not np.any(value.value) or "direction" in value.name or "transfer_function" in value.name:
            continue
        for factor in (1.02, 0.98):
            numbers = value.value * factor if value.relative else value.value + np.sign(factor - 1)
            text = "; ".join(f"{x:.10g}" for x in np.ravel(numbers).tolist())
            assert marked(value, text).kind != Kind.RIGHT, (value.name, text)
            one = np.array(value.value, dtype=float)  # one element of many
            places = np.flatnonzero(one)
            if value.relative:
                one.flat[rng.choice(places)] *= factor
                text = "; ".join(f"{x:.10g}" for x in np.ravel(one).tolist())
                assert marked(value, text).kind != Kind.RIGHT, (value.name, text)


@pytest.mark.parametrize("lab", LABS)
def test_each_confusion_of_the_key_is_named(lab: str) -> None:
    for value in asked(lab):
        for words, other in value.others.items():
            for digits in (3, 8):
                text = "; ".join(f"{x:.{digits}g}" for x in np.ravel(other).tolist())
                found = marked(value, text)
                if found.kind == Kind.SIGN:  # a confusion that is nothing but a sign
                    continue
                assert found.kind == Kind.OTHER, (value.name, words, found.words)
                assert words in found.words


def made(value: object, name: str = "gain", unit: str = "1", **others: object) -> AskedValue:
    return AskedValue(name, "a", "K", "gain", unit, np.array(value), THREE_DIGITS, 0.0, {k: np.array(v) for k, v in others.items()})


@pytest.mark.parametrize(
    ("value", "text", "words"),
    [
        (made(0.52346), "0.523", "right"),
        (made(0.52346), "52,3", "right, but in another unit: % for 1"),
        (made(0.52346), "52,3 %", "right"),
        (made(0.52346), "0.523 m", "the number is right, its unit is not: expected 1"),
        (made(0.52346), "-0.523", "right but for the sign"),
        (made(0.52346), "0.534", "wrong by 2 %"),
        (made(0.52346), "0.7 m", "wrong, and its unit is not 1"),
        (made(0.0), "0", "right"),
        (made(0.0), "0.1", "wrong"),
        (made(25.0, "posterior_variance", "m²"), "2500", "right, but in another unit"),
        (made(25.0, "posterior_variance", "m²"), "2,5·10^5", "right, but in another unit: cm² for m²"),
        (made(25.0, "posterior_variance", "m²"), "25", "right"),
        (made(25.0, "posterior_variance", "m²"), "5", "another convention: standard deviation for variance"),
        (made(5.0, "rms_error", "m"), "25", "another convention: variance for standard deviation"),
        (made(0.3, "angle", "rad"), "17.2", "right, but in another unit: ° for rad"),
        (made(0.3, "angle", "rad"), "17.2°", "right"),
        (made(10.0, "speed", "m/s"), "36", "right, but in another unit: km/h for m/s"),
        (made([0.5, 0.25]), "0,5; -0,25", "right but for the sign of 1 of 2 elements"),
        (made([0.5, 0.25]), "0,5; 0,27", "wrong: 1 of 2 elements, the first at 2, by up to 8 %"),
        (made([0.5, 0.25, 1.0]), "0.5, -, 1", "wrong: 1 of 3 elements, the first at 2; 1 left out"),
        (made([[1.0, 0.5], [0.0, 1.0]], "Phi"), "1 0\n0.5 1", "transposed"),
        (made([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], "P"), "1 4\n2 5\n3 6", "right (rows and columns exchanged)"),
        (made([0.6, 0.8], "unobservable_direction"), "-3; -4", "right (up to a factor, which is free)"),
        (made([0.6, 0.8], "unobservable_direction"), "3; 4.2", "wrong: 2 of 2 elements, the first at 1, by up to 420 %"),
        (made([0.5, 0.25], "Qd", "SI"), "50; 25 m", "wrong"),
        (made(True), "yes", "right"),
        (made(True), "no", "wrong"),
    ],
)  # fmt: skip
def test_what_an_answer_is(value: AskedValue, text: str, words: str) -> None:
    if words == "right, but in another unit":
        words = "wrong by 9900 %"  # a hundred is no unit of an area
    assert marked(value, text).words.startswith(words)


def test_no_answer_earns_nothing() -> None:
    assert marked(made(0.5), "").kind == Kind.NONE


def test_scales_are_those_of_a_person() -> None:
    assert dict(scales("m²/s"))["cm²/s"] == pytest.approx(1e4)
    assert dict(scales("1/s"))["1/h"] == pytest.approx(3600)
    assert scales("SI") == () == scales("m², m²/s")


def test_a_ratio_of_variances_has_no_standard_deviation() -> None:
    assert confused(made(0.5, "suboptimal_variance_ratio")) == {}
