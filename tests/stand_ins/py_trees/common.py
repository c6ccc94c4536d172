"""The states of a node."""

import enum


class Status(enum.Enum):
    SUCCESS, FAILURE, RUNNING, INVALID = "SUCCESS", "FAILURE", "RUNNING", "INVALID"
