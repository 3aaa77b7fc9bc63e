"""Parts of a storyboard: the state of each, and the time of its last change."""

from dataclasses import dataclass

from advercity.recordings.openscenario.stage import Stage

STANDBY, RUNNING, COMPLETE = "standbyState", "runningState", "completeState"
START, END, STOP, SKIP = "startTransition", "endTransition", "stopTransition", "skipTransition"


@dataclass
class StoryElement:
    """A story, act, maneuver group, maneuver, event or action.

    Attributes:
        state: Its state.
        transition: How it came into it.
        step: Step of the player at which it did.
        executions: How often it has run.
    """

    state: str = STANDBY
    transition: str = ""
    step: int = -1
    executions: int = 0

    def enter(self, state: str, transition: str, stage: Stage) -> None:
        """Come into a state."""
        self.state, self.transition, self.step = state, transition, stage.step

    def start(self, stage: Stage) -> None:
        """Begin to run."""
        self.executions += 1
        self.enter(RUNNING, START, stage)

    def is_in(self, state: str, stage: Stage) -> bool:
        """Return whether it is in a state, or made a transition in this step or the last."""
        if state.endswith("Transition"):
            return self.transition == state and stage.step - self.step <= 1
        return self.state == state
