"""Physical constants and vehicle limits for more than one package."""

import numpy as np

GRAVITY_M_S2 = 9.81
"""Standard acceleration of free fall, rounded as accident reconstruction does."""
GOLDEN_FRACTION = 0.618034
"""Its multiples modulo 1 spread evenly: actors of successive ids blink and step out of phase.

Six digits on purpose: more would move every pedestrian's legs in every dataset written so far.
"""
MAX_STEERING_RAD = np.radians(40.0)
"""Steering angle of a front wheel at full lock, typical of passenger cars."""
