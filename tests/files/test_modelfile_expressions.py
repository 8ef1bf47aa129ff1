"""Expressions of a model file: Python's arithmetic on the listed grammar, and nothing else."""

import ast
import math
import operator
import re

import hypothesis.strategies as st
import pytest
from hypothesis import given, settings

from ctlabs.files.modelfile.expressions import (
    CONSTANTS,
    DEPTH,
    DIGITS,
    EXPONENT,
    FUNCTIONS,
    LENGTH,
    RESERVED,
    ExpressionError,
    parse,
    values,
)  # fmt: skip
from ctlabs.files.modelfile.notation import latex_name

NAMES = {"q": 0.7, "tau": 2.5, "sigma_w2": 3.0, "n": -2.0}


class UndefinedError(Exception):
    """What Python cannot compute as a real finite number."""


PYTHON = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv, ast.Pow: operator.pow,
    ast.USub: operator.neg, ast.UAdd: operator.pos,
}  # fmt: skip


def by_python(text: str) -> float:
    """The value of an expression by Python's parser and Python's operators; precedence and associativity are Python's."""

    def value(node: ast.AST) -> float:
        if isinstance(node, ast.Constant):
            return float(node.value)
        if isinstance(node, ast.Name):
            return {**NAMES, "pi": math.pi, "e": math.e}[node.id]
        if isinstance(node, ast.UnaryOp):
            return PYTHON[type(node.op)](value(node.operand))
        if isinstance(node, ast.Call):
            function = {"abs": abs, "min": min, "max": max, "ln": math.log}.get(node.func.id) or getattr(
                math, node.func.id
            )
            return checked(function, *(value(a) for a in node.args))
        left, right = value(node.left), value(node.right)
        if isinstance(node.op, ast.Pow) and abs(right) > EXPONENT:
            raise UndefinedError
        return checked(PYTHON[type(node.op)], left, right)

    def checked(function, *operands):
        try:
            found = function(*operands)
        except (ZeroDivisionError, OverflowError, ValueError) as error:
            raise UndefinedError from error
        if isinstance(found, complex) or not math.isfinite(found):
            raise UndefinedError
        return found

    return value(ast.parse(text.replace("^", "**"), mode="eval").body)


numbers = st.one_of(
    st.integers(0, 20).map(str),
    st.floats(0, 1e3, allow_nan=False).map(repr),
    st.sampled_from(["1e-3", ".5", "5.", "2.5E2", "1e200", "0"]),
)
spaces = st.sampled_from(["", " ", "  "])


def compound(inner):
    """Larger expressions from smaller ones, with and without parentheses."""
    operators = st.sampled_from(["+", "-", "*", "/", "^", "**"])
    one = st.sampled_from(["sqrt", "exp", "log", "ln", "log10", "log2", "sin", "cos", "tan", "atan", "abs"])
    return st.one_of(
        st.tuples(inner, spaces, operators, spaces, inner).map("".join),
        inner.map(lambda x: f"({x})"),
        st.tuples(st.sampled_from("+-"), inner).map("".join),
        st.tuples(one, inner).map(lambda pair: f"{pair[0]}({pair[1]})"),
        st.tuples(st.sampled_from(["min", "max", "atan2"]), inner, inner).map(lambda p: f"{p[0]}({p[1]}, {p[2]})"),
    )


expressions = st.recursive(st.one_of(numbers, st.sampled_from([*NAMES, "pi", "e"])), compound, max_leaves=12)


@given(expressions)
@settings(deadline=None, max_examples=400, derandomize=True)
def test_values_are_pythons(text):
    """Whatever the grammar generates has the value that Python gives it, to the bit, or is refused where Python has none."""
    try:
        expected = by_python(text)
    except UndefinedError:
        with pytest.raises(ExpressionError):
            parse(text).value(NAMES)
        return
    assert parse(text).value(NAMES) == expected


def test_the_reference_distinguishes_precedence():
    """The oracle above would notice a wrong associativity: these differ from what a naive parser gives."""
    assert by_python("-2^2") == -4
    assert by_python("2^3^2") == 512
    assert by_python("8/4/2") == 1
    assert by_python("1-2-3") == -4
    assert by_python("2^-1") == 0.5


@given(st.text(max_size=60))
@settings(deadline=None, max_examples=400, derandomize=True)
def test_any_text_is_an_expression_or_an_error_of_one_line(text):
    """No text raises anything else, and every message is one printable line."""
    told = ""
    try:
        parse(text).value(NAMES)
    except ExpressionError as error:
        told = str(error)
    assert told.isprintable()


@given(st.text(alphabet="0123456789.eEqt+-*/^(), sincoabmxp", max_size=60))
@settings(deadline=None, max_examples=400, derandomize=True)
def test_texts_of_the_grammars_own_letters_do_no_harm(text):
    """Neither do texts that are nearly expressions."""
    names, value, told = set(), 0.0, ""
    try:
        found = parse(text)
        names = found.names
        value = found.value(NAMES)
    except ExpressionError as error:
        told = str(error)
    assert names <= set(re.findall(r"[^\W\d]\w*", text))
    assert not math.isnan(value)
    assert told.isprintable()


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os')", "().__class__", "q.real", "q[0]", "lambda: 1", "1 if q else 2", "q == 1", "q and 1", "'a'", "{1}", "[1]",
        "1; 2", "q = 1", "1 % 2", "1 // 2", "1 @ 2", "1 << 2", "~1", "1j", "0x10", "1_000", "\\", "`q`", "$q", "q!", "print(1)", "eval(1)",
    ],
)  # fmt: skip
def test_nothing_else_is_evaluated(text):
    """Python's other syntax is no expression."""
    with pytest.raises(ExpressionError):
        parse(text).value(NAMES)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("2*(q", 'column 5: expected ")" for the "(" in column 3, received the end'),
        ("q)", 'column 2: expected an operator or the end, received ")"'),
        ("*q", 'column 1: expected a number, a name or "(", received "*"'),
        ("", "expected a number or an expression, received an empty text"),
        ("0,5", 'column 2: expected an operator or the end, received ","; a decimal point is meant? write 0.5'),
        ("sqrt(0,5)", "column 1: sqrt: expected 1 argument, received 2; a decimal point is meant? write 0.5"),
        ("sqrt()", 'column 6: expected a number, a name or "(", received ")"'),
        ("sqrt q", 'column 6: expected "(" after the function sqrt, received "q"'),
        ("atan2(1)", "column 1: atan2: expected 2 arguments, received 1"),
        ("min(q)", "column 1: min: expected 2 arguments or more, received 1"),
        ("2q", 'column 2: expected an operator or the end, received "q"; to multiply, write 2*q'),
        ("2 (q)", 'column 3: expected an operator or the end, received "("; to multiply, write 2*('),
        ("1_000", 'column 2: expected an operator or the end, received "_000"; write 1000'),
        ("2−q", 'column 2: expected a number, a name, + - * / ^ or ( ), received "−"; write -'),
        ("lg(q)", 'column 1: unknown function "lg"; did you mean "log10"?'),
        *((f"{name}(q)", f'column 1: unknown function "{name}"; known are sqrt, exp, log, ln, log10, log2, sin, cos, tan, '
           "atan, atan2, abs, min, max; to multiply, write " + f"{name}*(")
          for name in ("arcsin", "acos", "sinh", "log1p", "expm1", "sind")),
        ("sqr(q)", 'column 1: unknown function "sqr"; did you mean "sqrt"?'),
        ("tua", 'unknown name "tua"; did you mean "tau"?'),
        ("PI", 'unknown name "PI"; did you mean "pi"?'),
        ("π", 'unknown name "π"; did you mean "pi"?'),
        ("t", 'expected a constant value, received "t", the time, which may not stand here'),
        ("1/(q-q)", "column 2: division by zero"),
        ("0^-1", "column 2: division by zero"),
        ("(-8)^(1/3)", "column 5: -8^0.333333 is complex: a negative number to a power that is not whole"),
        ("sqrt(-1)", "column 1: sqrt(-1) is not defined"),
        ("log(0)", "column 1: log(0) is not defined"),
        ("exp(1e3)", "column 1: exp(1000) is beyond double precision (overflow)"),
        ("1e308*10", "column 6: 1e+308 * 10 is beyond double precision (overflow)"),
        ("10^400", "column 3: 10 ^ 400 is beyond double precision (overflow)"),
        ("inf - inf", "column 5: inf - inf is not a number"),
        ("0*inf", "column 2: 0 * inf is not a number"),
        ("9**9**9", "column 2: expected an exponent from -1e+06 to 1e+06, received 3.8742e+08"),
        ("1e999", "column 1: expected a number within double precision, received 1e999"),
        ("1e-999", "column 1: expected a number within double precision, received 1e-999"),
    ],
)  # fmt: skip
def test_errors_say_what_and_where(text, message):
    """One line with the column, what was expected and what was received."""
    with pytest.raises(ExpressionError) as caught:
        parse(text).value(NAMES)
    assert str(caught.value) == message


def test_length_depth_and_digits_are_bounded():
    """At the bound an expression is read, one beyond it is refused; depth does not come near Python's own limit."""
    assert parse("1" + "+1" * ((LENGTH - 1) // 2)).value({}) == (LENGTH + 1) // 2
    for many in ("+".join(["1"] * LENGTH), "9" * (DIGITS + 1), "(" * (DEPTH + 1) + "1" + ")" * (DEPTH + 1)):
        with pytest.raises(ExpressionError, match="at most"):
            parse(many)
    assert parse("9" * DIGITS).value({}) == pytest.approx(10.0**DIGITS)
    assert parse("(" * DEPTH + "1" + ")" * DEPTH).value({}) == 1
    assert parse("-" * DEPTH + "1").value({}) == 1
    for deep in ("-" * (DEPTH + 1) + "1", "2" + "^2" * (DEPTH + 1), "sin(" * (DEPTH + 1) + "1" + ")" * (DEPTH + 1)):
        with pytest.raises(ExpressionError, match="levels of nesting"):
            parse(deep)


@pytest.mark.parametrize("value", [True, None, [1], {"a": 1}, float("nan"), 10**400])
def test_only_numbers_and_texts_are_expressions(value):
    """TOML's other types are refused, with the value."""
    with pytest.raises(ExpressionError, match="expected a number"):
        parse(value)


@pytest.mark.parametrize("value", [0, -3, 2.5, -1e-300, math.inf, -math.inf, 2**60])
def test_numbers_are_themselves(value):
    """A number of the file is an expression with that value."""
    assert parse(value).value({}) == value
    assert parse(value).constant


def test_infinity_passes_where_it_is_defined():
    """inf is a name; what is defined with it is computed."""
    assert parse("-inf").value({}) == -math.inf
    assert parse("1/inf").value({}) == 0
    assert parse("exp(-inf)").value({}) == 0
    assert parse("max(1, inf)").value({}) == math.inf


def test_names_are_those_that_need_a_value():
    """pi, e, inf and functions are none; t and k make an expression vary."""
    found = parse("pi*sqrt(q) + e^(-t/tau)")
    assert found.names == {"q", "t", "tau"}
    assert not found.constant
    assert parse("q*pi").constant
    assert set(CONSTANTS) | set(FUNCTIONS) | {"t", "k"} == RESERVED


def test_unknown_names_are_found_without_values():
    """check() tells an unknown name even behind a division by zero."""
    with pytest.raises(ExpressionError, match='unknown name "omga"; did you mean "omega"'):
        parse("1/0 + omga").check(["omega"])


def test_constants_refer_to_each_other_in_any_order():
    """A chain of a thousand constants, written backwards, is evaluated."""
    chain = {f"c{i}": parse(f"c{i + 1} + 1") for i in range(999)} | {"c999": parse("1")}
    found, wrong = values(chain)
    assert found["c0"] == 1000
    assert not wrong


@pytest.mark.parametrize(
    ("definitions", "cycle"),
    [
        ({"a": "b", "b": "a"}, "a -> b -> a"),
        ({"a": "a"}, "a -> a"),
        ({"x": "1", "b": "c", "c": "2*d", "d": "b + x"}, "b -> c -> d -> b"),
    ],
)
def test_cycles_are_named(definitions, cycle):
    """In the direction of the references, from the first of the file."""
    _, wrong = values({name: parse(text) for name, text in definitions.items()})
    assert str(wrong[""]) == cycle


def test_a_wrong_constant_is_told_once():
    """Those that refer to it are in neither answer; the others have their values."""
    found, wrong = values({"a": parse("1/0"), "b": parse("a"), "c": parse("2"), "d": parse("z")})
    assert found == {"c": 2}
    assert set(wrong) == {"a", "d"}


def test_renaming_touches_whole_names_only():
    """tau is not a part of tau2, and spaces stay."""
    assert parse(" tau *tau2+ sqrt( tau)").renamed("tau", "T") == " T *tau2+ sqrt( T)"


@pytest.mark.parametrize(
    ("text", "latex"),
    [
        ("a+b-c", "a + b - c"), ("a-(b-c)", r"a - \left(b - c\right)"), ("2*3", r"2 \cdot 3"),
        ("a*(b+c)", r"a\,\left(b + c\right)"), ("a/b/c", r"\frac{\frac{a}{b}}{c}"),
        ("(a/b)^2", r"\left(\frac{a}{b}\right)^{2}"), ("-a^2", "-a^{2}"), ("(-a)^2", r"\left(-a\right)^{2}"),
        ("-a*b", r"-a\,b"), ("a*-b", r"a\,\left(-b\right)"), ("a - -b", r"a - \left(-b\right)"),
        ("2^3^2", "2^{3^{2}}"), ("(2^3)^2", r"\left(2^{3}\right)^{2}"),
        ("sqrt(sigma_w2/tau)", r"\sqrt{\frac{\sigma_{w2}}{\tau}}"), ("abs(x0)", r"\left|x_{0}\right|"),
        ("exp(-t)", r"\exp\left(-t\right)"), ("atan2(y, x)", r"\mathrm{atan2}\left(y, x\right)"), ("inf", r"\infty"),
        ("1e-7*a", r"1\cdot 10^{-7}\,a"), ("a^-1", "a^{-1}"),
    ],
)  # fmt: skip
def test_expressions_become_equations(text, latex):
    """Parentheses stand where the written form would otherwise mean something else."""
    assert parse(text).latex() == latex


def test_numbers_become_equations():
    """A negative number holds together like a product with −1."""
    assert parse(-2).latex() == "-2"
    assert latex_name("_a_b") == r"\mathrm{a\_b}"


@given(expressions)
@settings(deadline=None, max_examples=100, derandomize=True)
def test_every_equation_has_balanced_braces(text):
    """Braces and \\left, \\right close."""
    found = parse(text).latex()
    assert found.count("{") == found.count("}")
    assert found.count(r"\left") == found.count(r"\right")
