"""Numerically different forms of one filter: what rounding does to each, and what each costs.

Algebraically all of them are the Kalman filter. ``conventional``, ``joseph`` and ``sequential`` carry P; ``potter``,
``carlson``, ``array`` and ``extended_array`` a square root of P; ``ud`` and ``ld`` its factors without square roots;
``information`` and ``srif`` carry P⁻¹ or a root of it; ``steady`` carries nothing but the estimate. One file each, on the
contract of :mod:`ctlabs.filtering.algorithms.contract`; each says what it computes, what that costs and what it cannot do. From
little or no information all of them begin by :mod:`ctlabs.filtering.algorithms.vague`.
:mod:`ctlabs.filtering.algorithms.catalogue` knows them by name.
"""
