"""Lab 24: the feedback of a known state, the regulator with an estimate, and what not knowing costs."""

from ctlabs import Cost, DiscreteModel, regulator

Phi, b, Q, R, Qx, Qu, P0 = 1.1, 0.5, 1.0, 2.0, 1.0, 0.25, 4.0


def plant(factor):
    """The plant with a factor Φ."""
    return DiscreteModel(Phi=[[factor]], B=[[b]], Qd=[[Q]], H=[[1]], R=[[R]], P0=[[P0]])


cost = Cost(Qx=[[Qx]], Qu=[[Qu]])
current = regulator(plant(Phi), cost)  # answers the measurement of its own instant
delayed = regulator(plant(Phi), cost, kind="delayed")

# (a): the known state
feedback_gain, cost_to_go, cost_known = current.L[0, 0], current.feedback.S[0, 0], current.cost.regulation

# (b): the estimate
gain_steady, cost_current, cost_delayed = current.K[0, 0], current.cost.value, delayed.cost.value
state_variance, input_variance = current.closed.steady().x.P[0, 0], current.closed.steady().u.P[0, 0]

# (e): ten steps, measured from the first one on
finite = regulator(plant(Phi), Cost([[Qx]], [[Qu]], Qf=[[Qx]], horizon=10))
feedback_gain_horizon, cost_horizon = finite.L[:, 0, 0], finite.cost.value

# (f): the plant has another factor
cost_actual = current.actual_cost(plant(1.2))

print(f"L = {feedback_gain:.5f}, K = {gain_steady:.5f}")
print(f"cost: known {cost_known:.5f}, current {cost_current:.5f}, delayed {cost_delayed:.5f}")
print(f"ten steps {cost_horizon:.5f}; with the true factor 1.2: {cost_actual:.5f}")
