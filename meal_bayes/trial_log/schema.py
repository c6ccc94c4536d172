"""The format of a log file: topics, message fields, version, limits.

To log one more thing, append a field here (never reorder: the place in the table is the field's
number), fill it in `encode.py`, read it in `decode.py`, and raise `FORMAT_VERSION` when a reader of
the old version would go wrong.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2

from meal_bayes.momdp.model import ARRAYS

FORMAT_VERSION = 5
FULL, COMPACT = "full", "compact"  # forms of a log: whole trials, or their outcomes alone
PROFILES = {FULL: "meal_bayes", COMPACT: "meal_bayes/outcomes"}  # in the MCAP header
SUFFIX = ".mcap"
ACTIVE = ".active"  # ends the name of a file that is still being written
END = "end.json"  # attachment behind the last trial: trials, steps and summed cost (s)

RUN, MOMDPS, TRIAL, STEP, OUTCOME = "/run", "/momdp", "/trial", "/step", "/outcome"
OUTCOMES = "/outcomes"  # of the compact form: columns of many trials in one message
LINES = "/log"  # for other tools; reading takes nothing from it

# Both sides keep to these limits, so that a damaged length can never ask for much memory.
MESSAGE_LIMIT = 8 << 20  # bytes of one message
RECORD_LIMIT = 16 << 20  # bytes of one MCAP record, packed or unpacked
TRIAL_LIMIT = 64 << 20  # bytes of one trial
NAME_LIMIT = 1000  # attributes, behaviors, or x of one MOMDP
MOMDP_MEMORY = 256  # a trial may refer to this many of the newest MOMDPs,
MOMDP_BYTES = 64 << 20  # as far as their messages have this many bytes
EDGE_LIMIT = 250_000  # edges of the search trees of one trial
COUNT_LIMIT = 4_000_000  # percept counts (N,E,K) of all beliefs of one trial

_SECOND = 1_000_000_000  # ns
_TRIAL_SPAN = 1000  # s between the starts of two trials on the log's clock

# A star marks a list; lists of more than one dimension are flat, in C order.
_BELIEF = "belief_x:int64 log_prob:double* positive:double* percept_counts:int64*"
_TREE = (
    "tree_level:int64* tree_parent:int64* tree_action:int64* tree_visits:int64* "
    "tree_value:double* tree_observation_size:int64* tree_observation:int64*"
)
_FIELDS = {
    "Run": "format_version:int64 header:string",
    "Momdp": (
        "id:int64 attributes:string* x_names:string* behavior_names:string* start:int64 "
        "transition:double* observation_probability:double* legal:bool* confusion:double* "
        "precision:double* prior:double* cost:double* correct:double incorrect:double "
        "bonus:double* limit:double* discount:double abstain:bool latent_classes:double* "
        "row_counts:double* group:int64*"
    ),
    "Trial": (
        "trial:int64 momdp:int64 agent:string name:string attributes:string* object_index:int64 "
        f"object_name:string key:string truth:int64* {_BELIEF}"
    ),
    "Step": (
        "trial:int64 step:int64 x:int64 action:int64 action_name:string report:bool* legal:bool* "
        "next_x:int64 observation:int64* cost:double reward:double values:double* "
        f"value_se:double* visits:int64* simulations:int64 {_TREE} {_BELIEF} warning:string "
        "sampled_rows:double* gap:double*"
    ),
    "Outcome": (
        "trial:int64 steps:int64 report:bool* success:int64 cost:double reward:double ended:string"
    ),
    "Outcomes": (  # columns of `TrialOutcomes`; text columns hold places in `texts`
        "first:int64 trials:int64 queried:int64 texts:string* behaviors:string* agent:int64* "
        "key:int64* object_index:int64* object_name:int64* attribute:int64* truth:int64* "
        "report:int64* positive:double* cost:double* reward:double* ended:int64* steps:int64* "
        "executed:int64* failed:int64*"
    ),
}
MOMDP_ARRAYS = ARRAYS  # fields of a MOMDP that have its own names
TASK_VALUES = ("name", "object_index", "object_name")  # by the names of `Task`
STEP_VALUES = ("x", "next_x", "cost", "reward", "warning")  # by the names of `Step`
DECISION_ARRAYS = {"values": float, "value_se": float, "visits": int}
MOMDP_NUMBERS = ("start", "correct", "incorrect", "discount", "abstain")
_LOG = "timestamp:time level:level message:string name:string file:string line:fixed32"
_LEVELS = ("UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL")  # of foxglove.Log
_TOPICS = {RUN: "Run", MOMDPS: "Momdp", TRIAL: "Trial", STEP: "Step", OUTCOME: "Outcome"}
_COMPACT_TOPICS = {RUN: "Run", OUTCOMES: "Outcomes"}


def _file_of(package: str, name: str, fields: str) -> descriptor_pb2.FileDescriptorProto:
    """Build the file of one message; fields are numbered as they stand."""
    types = descriptor_pb2.FieldDescriptorProto
    file = descriptor_pb2.FileDescriptorProto(
        name=f"{package}/{name}.proto", package=package, syntax="proto3"
    )
    message = file.message_type.add(name=name)
    for number, entry in enumerate(fields.split(), start=1):
        field, kind = entry.split(":")
        label = types.LABEL_REPEATED if kind.endswith("*") else types.LABEL_OPTIONAL
        added = message.field.add(name=field, number=number, label=label)
        if kind == "time":
            file.dependency.append(timestamp_pb2.DESCRIPTOR.name)
            added.type, added.type_name = types.TYPE_MESSAGE, ".google.protobuf.Timestamp"
        elif kind == "level":
            added.type, added.type_name = types.TYPE_ENUM, f".{package}.{name}.Level"
            level = message.enum_type.add(name="Level")
            for value, word in enumerate(_LEVELS):
                level.value.add(name=word, number=value)
        else:
            added.type = getattr(types, f"TYPE_{kind.rstrip('*').upper()}")
    return file


_TIMESTAMP = descriptor_pb2.FileDescriptorProto.FromString(timestamp_pb2.DESCRIPTOR.serialized_pb)
_FILES = {name: _file_of("meal_bayes", name, fields) for name, fields in _FIELDS.items()}
_LOG_FILE = _file_of("foxglove", "Log", _LOG)
# A pool of our own: another library may have registered foxglove.Log in the common one.
_POOL = descriptor_pool.DescriptorPool()
for _file in (_TIMESTAMP, _LOG_FILE, *_FILES.values()):
    _POOL.Add(_file)


def _message_class(full_name: str) -> Any:
    return message_factory.GetMessageClass(_POOL.FindMessageTypeByName(full_name))


RunMessage = _message_class("meal_bayes.Run")
MomdpMessage = _message_class("meal_bayes.Momdp")
TrialMessage = _message_class("meal_bayes.Trial")
StepMessage = _message_class("meal_bayes.Step")
OutcomeMessage = _message_class("meal_bayes.Outcome")
OutcomesMessage = _message_class("meal_bayes.Outcomes")
LogMessage = _message_class("foxglove.Log")


def channels(form: str) -> Iterator[tuple[str, str, bytes]]:
    """Yield topic, schema name and schema data of a form's channels, in the order of their ids."""
    for topic, name in (_TOPICS if form == FULL else _COMPACT_TOPICS).items():
        files = descriptor_pb2.FileDescriptorSet(file=[_FILES[name]])
        yield topic, f"meal_bayes.{name}", files.SerializeToString()
    if form == FULL:
        files = descriptor_pb2.FileDescriptorSet(file=[_TIMESTAMP, _LOG_FILE])
        yield LINES, "foxglove.Log", files.SerializeToString()


def log_time(trial: int, step: int) -> int:
    """Compute the time on the log's clock, ns; it counts steps, so that equal runs are equal files.

    >>> log_time(2, 3)
    2003000000000
    """
    return (trial * _TRIAL_SPAN + min(step, _TRIAL_SPAN - 1)) * _SECOND


class Known(NamedTuple):
    """What reader or writer knows of a MOMDP in the file, and the bytes of its message."""

    value: Any
    size: int


def forget_oldest(momdps: dict[Any, Known]) -> None:
    """Forget the oldest MOMDPs, beyond what a trial may refer back to."""
    sizes = [known.size for known in momdps.values()]
    while len(sizes) > 1 and (len(sizes) > MOMDP_MEMORY or sum(sizes) > MOMDP_BYTES):
        del momdps[next(iter(momdps))], sizes[0]
