r"""The letter of a parameter in an equation, from its name: ``sigma_w2`` is \sigma_w^2."""

from __future__ import annotations

import re

GREEK = (
    "alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "kappa", "lambda", "mu", "nu", "xi", "pi", "rho", "sigma",
    "tau", "phi", "chi", "psi", "omega", "Gamma", "Delta", "Theta", "Lambda", "Xi", "Pi", "Sigma", "Phi", "Psi", "Omega",
)  # fmt: skip
_HEAD = re.compile(rf"({'|'.join(sorted(GREEK, key=len, reverse=True))}|[A-Za-z])(\d*)(?:_(\w+?))?(2?)$")
_TAILS = {"star": "*", "max": r"{\max}", "min": r"{\min}"}


def symbol(name: str) -> str:
    r"""The letter of ``name`` in LaTeX; a word stays a word.

    >>> [symbol(name) for name in ("Phi", "P0", "K_star", "sigma_w2", "sigma_theta", "R", "dt")]
    ['\\Phi', 'P_0', 'K_*', '\\sigma_w^2', '\\sigma_\\theta', 'R', '\\Delta t']
    >>> symbol("steps")
    '\\text{steps}'
    """
    if name == "dt":
        return r"\Delta t"
    found = _HEAD.fullmatch(name)
    if found is None:
        return rf"\text{{{name.replace('_', ' ')}}}"
    letter, digits, index, square = found.groups()
    head = rf"\{letter}" if letter in GREEK else letter
    if index is None and digits.endswith("2") and letter in GREEK:
        return f"{head}^2"
    tail = "" if not index else rf"\{index}" if index in GREEK else _TAILS.get(index, index)
    under = digits + tail
    low = "" if not under else f"_{under}" if len(under) == 1 or (not digits and tail[0] in "{\\") else f"_{{{under}}}"
    return f"{head}{low}" + ("^2" if square else "")
