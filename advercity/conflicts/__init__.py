"""Solve conflicts: where the ways meet, who comes from where, and how fast.

`drive` and `casting` say how the ego goes and who takes part, and a `Case` holds both. `crossing`,
`opposite`, `overtaking` and `through` each find the places for one way of coming, `placing`
chooses among them, `actors` makes records of those placed, and `solution` puts all together.
"""

from advercity.conflicts.case import UnsolvableError
from advercity.conflicts.solver import solve_conflict

__all__ = ["UnsolvableError", "solve_conflict"]
