"""Questions of yes or no: read as they are meant, and true where all value vectors say so."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from meal_bayes.domain import Event, Payoffs, Query, load_domain, read_event, read_query
from meal_bayes.domain.tables import domain_from_table, domain_table
from meal_bayes.errors import DomainError, MealBayesError, QueryError

ROC36 = load_domain("roc36")
COLORS = ("brown", "green", "blue")


@st.composite
def queries(draw):
    """Draw a query of one to three variables, two to four values a group, and an event."""
    sizes = draw(st.lists(st.integers(1, 4), min_size=1, max_size=3))
    groups = []
    first = 0
    for size in sizes:
        if size > 1:
            groups.append(tuple(range(first, first + size)))
        first += size
    allowed = tuple(draw(st.lists(st.booleans(), min_size=first, max_size=first)))
    for group in groups:
        members = [allowed[place] for place in group]
        assume(any(members) and not all(members))
    names = tuple(f"p{i}" for i in range(first))
    return Query(names, tuple(groups), event=Event(allowed, draw(st.booleans())))


def holds(query, values):
    """Return whether the event is true of a value vector, by its definition."""
    literals = [
        any(values[p] and query.event.allowed[p] for p in places)
        if len(places) > 1
        else values[places[0]] == query.event.allowed[places[0]]
        for places in query.variables
    ]
    return all(literals) != query.event.complement


@given(queries(), st.integers(0, 2**32 - 1))
def test_probability_is_the_sum_over_value_vectors(query, seed):
    rng = np.random.default_rng(seed)
    positive = np.zeros(len(query))
    for places in query.variables:
        row = rng.dirichlet(np.ones(max(2, len(places))))
        positive[list(places)] = row if len(places) > 1 else row[:1]
    total = 0.0
    for values in query.values:
        p = 1.0
        for places in query.variables:
            if len(places) > 1:
                p *= positive[list(places)][values[list(places)]].item()
            else:
                p *= positive[places[0]] if values[places[0]] else 1 - positive[places[0]]
        total += p * holds(query, values)
    assert query.event.probability(positive, query.variables) == pytest.approx(total)


@given(queries(), st.data())
def test_the_right_answer_is_known_where_all_that_is_possible_agrees(query, data):
    truth = np.array(data.draw(st.sampled_from(query.values.tolist())), np.int8)
    hidden = data.draw(st.lists(st.booleans(), min_size=len(query), max_size=len(query)))
    truth[hidden] = -1
    possible = [v for v in query.values if all((truth < 0) | (v == truth))]
    answers = {holds(query, values) for values in possible}
    right = query.report_truth(truth)
    assert right.tolist() == [int(answers.pop()) if len(answers) == 1 else -1]


@given(queries(), st.booleans())
def test_an_answer_labels_what_it_implies_and_nothing_else(query, answer):
    possible = np.array([v for v in query.values if holds(query, v) == answer])
    labels = query.event.labels(answer, query.variables)
    implied = np.where(possible.all(axis=0), 1, np.where(possible.any(axis=0), -1, 0))
    np.testing.assert_array_equal(labels, implied)


@pytest.mark.parametrize(
    ("question", "text", "attributes"),
    [
        ("Is it red and not heavy?", "brown and not heavy?", ("brown", "heavy")),
        ("Is it neither heavy nor blue?", "not heavy and not blue?", ("heavy", "blue")),
        ("Is it heavy, or not beans?", "heavy or not beans?", ("heavy", "beans")),
        ("Is it red or blue?", "brown or blue?", COLORS),
        ("Is it not red and not blue?", "green?", COLORS),
        ("Is it heavy?", "heavy?", ("heavy",)),
        ("is it NOT heavy", "not heavy?", ("heavy",)),
        (["heavy", "not beans"], "heavy and not beans?", ("heavy", "beans")),
    ],
)
def test_reading(question, text, attributes):
    query = read_event(question, ROC36)
    assert (query.text, query.attributes) == (text, attributes)
    assert read_event(query.text, ROC36).report_truth is not None


MEANINGS = {
    "{} and {}": lambda a, b: a and b,
    "{}, {}?": lambda a, b: a and b,
    "{} & {}": lambda a, b: a and b,
    "both {} and {}": lambda a, b: a and b,
    "{} but not {}": lambda a, b: a and not b,
    "{} or {}": lambda a, b: a or b,
    "either {} or {}": lambda a, b: a or b,
    "not {} or {}": lambda a, b: not a or b,
    "not {} or not {}": lambda a, b: not a or not b,
    "neither {} nor {}": lambda a, b: not a and not b,
    "neither {} or {}": lambda a, b: not a and not b,
    "not {} nor {}": lambda a, b: not a and not b,
    "no {} and no {}": lambda a, b: not a and not b,
    "neither {}, {} nor {}": lambda a, b, c: not a and not b and not c,
    "neither {} nor {} nor {}": lambda a, b, c: not a and not b and not c,
    "neither {} nor {}, and {}": lambda a, b, c: not a and not b and c,
    "made out of {}": lambda a: a,
    "{}, {} and without {}": lambda a, b, c: a and b and not c,
}
AMBIGUOUS = (
    "!{}", "~{}", "-{}", "{} | {}", "{} || {}", "{} && !{}", "not ({} and {})", "({} or {})",
    "not not {}", "not without {}", "neither not {} nor {}", "{} and not and {}", "{} if {}",
    "not both {} and {}", "not either {} or {}", "neither {} and {}", "{} nor {}",
    "out of {}", "not out of {}", "{} and out of {}", "without {} or {}", "no {}, {}",
    "{} != {}", "{} xor {}", "{} / {}",
)  # fmt: skip
PLAIN = load_domain("cy101")
NAMES = [name for name in PLAIN.attributes if name.isalpha()]


@given(st.sampled_from(sorted(MEANINGS)), st.permutations(NAMES), st.booleans())
def test_a_question_holds_where_what_it_says_in_words_does(form, names, loud):
    meaning = MEANINGS[form]
    count = form.count("{}")
    question = f"Is it {form.format(*names[:count])}"
    query = read_event(question.upper() if loud else question, PLAIN)
    places = [query.attributes.index(name) for name in names[:count]]
    for values in query.values:
        said = bool(meaning(*values[places].tolist()))
        assert query.report_truth(values.astype(np.int8)).tolist() == [said]


@given(st.sampled_from(AMBIGUOUS), st.permutations(NAMES))
def test_what_may_be_meant_in_two_ways_is_refused(form, names):
    with pytest.raises(QueryError) as fault:
        read_event(f"Is it {form.format(*names)}?", PLAIN)
    assert "\n" not in str(fault.value)


@pytest.mark.parametrize(
    "question", ["If it is {}, is it {}?", "if {} then {}", "If {}, is it not {}?"]
)
@pytest.mark.parametrize("asks", ["Tell me if it is {} and {}", "Can you see if it is {} and {}?"])
def test_a_condition_is_not_asked_for(question, asks):
    with pytest.raises(QueryError, match="'if'"):
        read_event(question.format("heavy", "red"), ROC36)
    assert read_event(asks.format("heavy", "red"), ROC36).text == "heavy and brown?"


@pytest.mark.parametrize("question", ["!heavy", "~heavy", "heavy | blue", "-heavy", "heavy = no"])
def test_signs_of_negation_are_no_values(question):
    with pytest.raises(QueryError, match="The question contains"):
        read_query(question, ROC36)


def test_a_group_may_stand_beside_its_value():
    assert read_event("Is the color red, and is it heavy?", ROC36).text == "brown and heavy?"
    assert read_query("light medium heavy", ROC36).group_names == ("weight",)
    assert read_query("Is it heavy!", ROC36).attributes == ("heavy",)


def test_one_attribute_is_the_question_of_its_value():
    assert read_event("Is it heavy?", ROC36) == read_query("Is it heavy?", ROC36)


@pytest.mark.parametrize(
    ("question", "says"),
    [
        ("heavy and blue or rice", "mixes"),
        ("red and blue", "exactly one is true"),
        ("red or green or blue", "the answer is known"),
        ("isn't it heavy?", "isn't"),
        ("heavy and not", 'ends with a "not"'),
        ("color", "is one of brown, green, blue"),
        ("hevy", "did you mean 'heavy'"),
        ("heavy and not heavy", "twice"),
        ("", "No attribute"),
        ("xor heavy", "xor"),
        (7, "A question is a sentence"),
    ],
)
def test_what_cannot_be_answered_is_said_in_one_line(question, says):
    with pytest.raises(QueryError, match=says) as fault:
        read_event(question, ROC36)
    assert "\n" not in str(fault.value)


@given(st.text(alphabet=st.sampled_from("abc ,?'"), max_size=12), st.sampled_from(
    ["{} and not {}", "not {}", "{} or heavy", "heavy {} blue", "{}"]))  # fmt: skip
def test_no_sentence_raises_anything_else(words, form):
    try:
        query = read_event(form.format(words, words), ROC36)
    except MealBayesError:
        return
    assert query.yes_or_no


@pytest.mark.parametrize(
    "payoffs", [(1, 2, 3), "abcd", (1, 2, 3, np.nan), (0, 0, 0, 1), (0, 1, 0, 0), (1, -1, 1, 1e300)]
)
def test_payoffs_are_four_numbers_that_pay_for_being_right(payoffs):
    with pytest.raises(QueryError, match="ayoffs"):
        Payoffs.of(payoffs)


def test_payoffs_of_a_domain_are_kept_in_its_table():
    four = {"right_yes": 10, "wrong_yes": -20, "right_no": 5, "wrong_no": -100}
    domain = load_domain({"extends": "toy", "name": "dear", "payoffs": four})
    assert domain.payoffs == Payoffs(10.0, -20.0, 5.0, -100.0)
    assert domain_from_table(domain_table(domain)) == domain
    assert load_domain("toy").payoffs is None
    with pytest.raises(DomainError, match="payoffs"):
        load_domain({"extends": "toy", "name": "dear", "payoffs": {"right_yes": 3}})


def test_payoffs_are_of_yes_and_no_alone():
    with pytest.raises(QueryError, match="about 2 attributes"):
        Query(("heavy", "blue"), payoffs=Payoffs(1, -1, 1, -1))


@pytest.mark.parametrize("word", ["not", "AND", "neither"])
def test_words_that_join_or_deny_name_no_attribute(word):
    with pytest.raises(DomainError, match="joins or denies"):
        load_domain({"extends": "toy", "name": "odd", "synonyms": {word: "heavy"}})
