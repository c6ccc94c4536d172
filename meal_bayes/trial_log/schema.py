"""The format of a log file: topics, message fields, version, limits.

To log one more thing, append a field here (never reorder: the place in the table is the field's
number), fill it in `encode.py`, read it in `decode.py`, and raise `FORMAT_VERSION` when a reader of
the old version would go wrong.
"""

from collections.abc import Iterator
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2

from meal_bayes import untrusted
from meal_bayes.momdp.numbers import ARRAYS

FORMAT_VERSION = 5
FULL = "full"  # the form of a log that holds whole trials
COMPACT = "compact"  # ... that holds their outcomes alone
FEEDBACK_FORM = "feedback"  # ... that holds what a person told of a trial when that was over
PROFILES = {  # in the MCAP header
    FULL: "meal_bayes", COMPACT: "meal_bayes/outcomes", FEEDBACK_FORM: "meal_bayes/feedback",
}  # fmt: skip
SUFFIX = ".mcap"
ACTIVE = ".active"  # ends the name of a file that is still being written
END = "end.json"  # attachment behind the last trial: trials, steps and summed cost (s)

RUN = "/run"
MOMDPS = "/momdp"
TRIAL = "/trial"
STEP = "/step"
OUTCOME = "/outcome"
OUTCOMES = "/outcomes"  # of the compact form: columns of many trials in one message
FEEDBACK = "/feedback"  # of the form of that name: one message
ASK = "Learner.ask"  # command of the logs of trials with a robot
LINES = "/log"  # for other tools; reading takes nothing from it


def _room(features: int) -> int:
    """Return bytes that hold features, 4 each, and as much beside them; a power of two.

    >>> _room(1_000_000) == 8 << 20
    True
    """
    return 2 << (4 * features - 1).bit_length()


# Both sides keep to these limits, so that a damaged length can never ask for much memory.
FEATURE_LIMIT = 1_000_000  # features of one step; of a step that has more none are logged
TRIAL_FEATURES = 8_000_000  # of a trial; of the steps beyond so many none are logged
MESSAGE_LIMIT = _room(FEATURE_LIMIT)  # bytes of one message, such as a step
RECORD_LIMIT = 2 * MESSAGE_LIMIT  # bytes of one MCAP record, packed or unpacked
TRIAL_LIMIT = _room(TRIAL_FEATURES)  # bytes of one trial
NAME_LIMIT = untrusted.NAME_LIMIT  # attributes, behaviors, or x of one MOMDP; labels of a telling
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
    "meal_bayes.Run": "format_version:int64 header:string",
    "meal_bayes.Momdp": (
        "id:int64 attributes:string* x_names:string* behavior_names:string* start:int64 "
        "transition:double* observation_probability:double* legal:bool* confusion:double* "
        "precision:double* prior:double* cost:double* correct:double incorrect:double "
        "bonus:double* limit:double* discount:double abstain:bool latent_classes:double* "
        "row_counts:double* group:int64* group_name:string* "
        "payoffs:double* own_payoffs:bool literal:bool* complement:bool bonus_limit:double* "
        "x_labels:string* joint:double*"
    ),
    "meal_bayes.Trial": (
        "trial:int64 momdp:int64 agent:string name:string attributes:string* object_index:int64 "
        f"object_name:string key:string truth:int64* {_BELIEF} test:bool"
    ),
    "meal_bayes.Step": (
        "trial:int64 step:int64 x:int64 action:int64 action_name:string report:bool* legal:bool* "
        "next_x:int64 observation:int64* cost:double reward:double values:double* "
        f"value_se:double* visits:int64* simulations:int64 {_TREE} {_BELIEF} warning:string "
        "sampled_rows:double* gap:double* bonus:double* tree_bonus:double* "
        "recording:int64* modality:string* feature_count:int64* features:float* "
        "detected:string* detection:double*"
    ),
    "meal_bayes.Outcome": (
        "trial:int64 steps:int64 report:bool* success:int64 cost:double reward:double ended:string"
    ),
    "meal_bayes.Outcomes": (  # columns of `TrialOutcomes`; text columns hold places in `texts`
        "first:int64 trials:int64 queried:int64 texts:string* behaviors:string* agent:int64* "
        "key:int64* object_index:int64* object_name:int64* attribute:int64* truth:int64* "
        "report:int64* positive:double* cost:double* reward:double* ended:int64* steps:int64* "
        "executed:int64* failed:int64* certainty:double*"
    ),
    "meal_bayes.Feedback": (
        "object_name:string key:string attributes:string* labels:int64* recordings:int64"
    ),
    "foxglove.Log": (
        "timestamp:time level:level message:string name:string file:string line:fixed32"
    ),
}
# By the names of `MOMDP`; the bonus limit is missing in older logs.
MOMDP_ARRAYS = {name: axes for name, axes in ARRAYS.items() if name != "bonus_limit"}
TASK_VALUES = ("name", "object_index", "object_name")  # by the names of `Task`
STEP_VALUES = ("x", "next_x", "cost", "reward", "warning")  # by the names of `Step`
EDGE_VALUES = ("level", "parent", "action", "visits", "value", "bonus")  # of `TreeEdge`
DECISION_ARRAYS = ("values", "value_se", "visits")  # by the names of `Decision`
MOMDP_NUMBERS = ("start", "correct", "incorrect", "discount", "abstain")
_LEVELS = ("UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL")  # of foxglove.Log
# Messages of a form's topics, in the order of their channels' ids.
TOPICS = {
    FULL: {
        RUN: "meal_bayes.Run", MOMDPS: "meal_bayes.Momdp", TRIAL: "meal_bayes.Trial",
        STEP: "meal_bayes.Step", OUTCOME: "meal_bayes.Outcome", LINES: "foxglove.Log",
    },
    COMPACT: {RUN: "meal_bayes.Run", OUTCOMES: "meal_bayes.Outcomes"},
    FEEDBACK_FORM: {RUN: "meal_bayes.Run", FEEDBACK: "meal_bayes.Feedback"},
}  # fmt: skip


def _file_of(full_name: str, fields: str) -> descriptor_pb2.FileDescriptorProto:
    """Build the file of one message; fields are numbered as they stand."""
    types = descriptor_pb2.FieldDescriptorProto
    package, name = full_name.split(".")
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
            added.type = types.TYPE_MESSAGE
            added.type_name = ".google.protobuf.Timestamp"
        elif kind == "level":
            added.type = types.TYPE_ENUM
            added.type_name = f".{full_name}.Level"
            level = message.enum_type.add(name="Level")
            for value, word in enumerate(_LEVELS):
                level.value.add(name=word, number=value)
        else:
            added.type = getattr(types, f"TYPE_{kind.rstrip('*').upper()}")
    return file


_TIMESTAMP = descriptor_pb2.FileDescriptorProto.FromString(timestamp_pb2.DESCRIPTOR.serialized_pb)
_FILES = {name: _file_of(name, fields) for name, fields in _FIELDS.items()}
# A pool of our own: another library may have registered foxglove.Log in the common one.
_POOL = descriptor_pool.DescriptorPool()
for _file in (_TIMESTAMP, *_FILES.values()):
    _POOL.Add(_file)
_NAMES = [file.name for file in _FILES.values()]
_CLASSES: dict[str, Any] = message_factory.GetMessageClassesForFiles(_NAMES, _POOL)
RunMessage = _CLASSES["meal_bayes.Run"]
MomdpMessage = _CLASSES["meal_bayes.Momdp"]
TrialMessage = _CLASSES["meal_bayes.Trial"]
StepMessage = _CLASSES["meal_bayes.Step"]
OutcomeMessage = _CLASSES["meal_bayes.Outcome"]
OutcomesMessage = _CLASSES["meal_bayes.Outcomes"]
FeedbackMessage = _CLASSES["meal_bayes.Feedback"]
LogMessage = _CLASSES["foxglove.Log"]


def channels(form: str) -> Iterator[tuple[str, str, bytes]]:
    """Yield topic, schema name and schema data of a form's channels."""
    for topic, name in TOPICS[form].items():
        files = [_TIMESTAMP, _FILES[name]] if topic == LINES else [_FILES[name]]
        yield topic, name, descriptor_pb2.FileDescriptorSet(file=files).SerializeToString()


def log_time(trial: int, step: int) -> int:
    """Compute the time on the log's clock, ns; it counts steps, so that equal runs are equal files.

    >>> log_time(2, 3)
    2003000000000
    """
    return (trial * _TRIAL_SPAN + min(step, _TRIAL_SPAN - 1)) * _SECOND


class Momdps(dict[Any, tuple[Any, int]]):
    """What reader or writer knows of the MOMDPs in a file, with the bytes of their messages."""

    def add(self, key: Any, value: Any, size: int) -> None:
        """Add the next MOMDP; forget the oldest, beyond what a trial may refer back to."""
        self[key] = value, size
        sizes = [size for _, size in self.values()]
        while len(sizes) > 1 and (len(sizes) > MOMDP_MEMORY or sum(sizes) > MOMDP_BYTES):
            del self[next(iter(self))], sizes[0]
