"""The two states of a goal that the page names."""


class GoalStatus:
    STATUS_SUCCEEDED, STATUS_ABORTED = 4, 6
