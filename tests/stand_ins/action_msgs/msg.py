"""The two states of a goal that the page names."""


class GoalStatus:
    STATUS_SUCCEEDED = 4
    STATUS_ABORTED = 6
