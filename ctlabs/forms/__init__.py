"""Numerically different forms of one filter: what rounding does to each, and what each costs.

Algebraically all of them are the Kalman filter. ``conventional``, ``joseph`` and ``sequential`` carry P; ``potter``,
``carlson``, ``array`` and ``extended_array`` a square root of P; ``ud`` and ``ld`` its factors without square roots;
``information`` and ``srif`` carry P⁻¹ or a root of it; ``steady`` carries nothing but the estimate. One file each, on the
contract of :mod:`ctlabs.forms.contract`; each says what it computes, what that costs and what it cannot do. From little or no
information all of them begin by :mod:`ctlabs.forms.vague`.

:func:`run` filters data with one of them, :func:`compare` sets all side by side against :func:`reference`, a filter with
50 digits on the same doubles, and :func:`flops` counts the operations of a step.
"""

from ctlabs.forms.run import DIGITS, FORMS, Comparison, Filtered, Record, compare, flops, reference, run

__all__ = ["DIGITS", "FORMS", "Comparison", "Filtered", "Record", "compare", "flops", "reference", "run"]
