"""Questions are read as they are meant; a group is one variable, in questions and in labels."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from meal_bayes.datasets import Dataset
from meal_bayes.domain import Query, load_domain, read_event, read_query
from meal_bayes.errors import DataError, DomainError, QueryError

CAFE = "Caf\N{LATIN SMALL LETTER E WITH ACUTE}"
ROC36, ISPY32, CY101 = (load_domain(name) for name in ("roc36", "ispy32", "cy101"))


@pytest.mark.parametrize(
    ("question", "domain", "attributes"),
    [
        ("Is it heavy, and does it hold beans?", ROC36, ("heavy", "beans")),
        ("Is this container green?", ROC36, None),
        ("is it RED and empty?", ROC36, None),
        ("Is it RED and does it contain screws?", ROC36, ("brown", "screws")),
        ("heavy, beans", ROC36, ("heavy", "beans")),
        ("It's light, isn't it?", ROC36, None),
        ("What's its weight: heavy?", ROC36, ("heavy",)),
        (["Heavy", " red "], ROC36, ("heavy", "brown")),
        ("Is it pencil-shaped and 'half-full' of water?", ISPY32,
         ("pencil-shaped", "half-full", "water")),
        ("Is the object heavy and metallic?", ISPY32, ("heavy", "metallic")),
        ("Is this thing colored?", ISPY32, ("colored",)),
        ("Is it a thing?", ISPY32, ("thing",)),
        ("Is it a plastic container?", CY101, ("plastic", "container")),
        ("Is it soft \N{EM DASH} and hard?", CY101, ("soft", "hard")),
    ],
)  # fmt: skip
def test_reading(question, domain, attributes):
    if attributes is None:
        with pytest.raises(QueryError):
            read_query(question, domain)
    else:
        assert read_query(question, domain).attributes == attributes


@pytest.mark.parametrize(
    ("question", "says"),
    [
        ("Is it haevy?", "Unknown attribute 'haevy': did you mean 'heavy'"),
        (["beens"], "did you mean 'beans'"),
        ("heavy and heavy", "names 'heavy' twice; name each attribute once"),
        ("red and brown", "names 'brown' twice"),
        ("Is it not heavy?", "contains 'not'. List the attributes"),
        ("Isn't it heavy?", 'contains "isn\'t". List the attributes'),
        ("Is it out of beans?", 'says "out of", which may deny'),
        ("Is it heavy or light?", "contains 'or'. List the attributes"),
        ("", "No attribute found in ''; expected some of: light"),
        ([], "names no attribute; name at least one"),
        ([""], "Unknown attribute ''"),
    ],
)
def test_bad_questions_teach_in_one_line(question, says):
    with pytest.raises(QueryError, match=says) as caught:
        read_query(question, ROC36)
    assert "\n" not in str(caught.value)


def domain_of(*attributes, **options):
    table = {"name": "own", "extends": "toy", "attributes": attributes, **options}
    return load_domain(table)


def test_words_are_equal_whatever_their_case_and_coding():
    domain = domain_of(CAFE, "gro\N{LATIN SMALL LETTER SHARP S}", "Very Heavy")
    for question in ("is it cafe\N{COMBINING ACUTE ACCENT}?", ["CAFE\N{COMBINING ACUTE ACCENT}"]):
        assert read_query(question, domain).attributes == domain.attributes[:1]
    assert read_query("GROSS", domain).attributes == domain.attributes[1:2]
    assert read_query("is it VERY heavy?", domain).attributes == domain.attributes[2:]


@pytest.mark.parametrize(
    "options",
    [
        {"synonyms": {"Red": "blue"}},  # would steal the attribute "red"
        {"synonyms": {"crimson": "red", "Crimson": "blue"}},
        {"attributes": ["red", "RED"]},
        {"attributes": [CAFE, "cafe\N{COMBINING ACUTE ACCENT}"]},
    ],
)
def test_no_word_is_of_two_attributes(options):
    with pytest.raises(DomainError, match="The word"):
        domain_of(**{"attributes": ["red", "blue"], **options})


def test_an_attribute_with_a_comma_could_not_be_asked():
    with pytest.raises(DomainError, match="holds a comma"):
        domain_of("red, or nearly")


@given(st.integers(1, 8), st.data())
def test_rows_and_indices_agree(n, data):
    query = Query(tuple(f"p{i}" for i in range(n)))
    y = data.draw(st.integers(0, 2**n - 1))
    np.testing.assert_array_equal(query.values[y], query.values_of(y))
    assert query.index_of(query.values_of(y)) == y
    assert query.report_names[y] == query.report_name(query.values_of(y))


def test_the_first_attribute_is_the_most_significant_bit():
    query = Query(("heavy", "beans"))
    assert query.index_of([True, False]) == 2
    assert query.report_names[2] == "heavy, not beans"


def test_large_queries_have_indices_but_no_table():
    query = Query(tuple(f"p{i}" for i in range(81)))
    assert query.index_of(query.values_of(2**80 + 5)) == 2**80 + 5
    with pytest.raises(QueryError, match="do not fit in a table"):
        _ = query.values


ROC36 = load_domain("roc36")
CUP = {"extends": "toy", "name": "cup", "attributes": ["metal", "empty", "half", "full"]}
LAB = load_domain(CUP | {"groups": {"fill": ["empty", "half", "full"]}})
CONTENT = ROC36.groups["content"]


@pytest.mark.parametrize(
    ("question", "domain", "attributes", "groups"),
    [
        ("fill", LAB, ("empty", "half", "full"), ((0, 1, 2),)),
        (["metal", "Fill"], LAB, ("metal", "empty", "half", "full"), ((1, 2, 3),)),
        ("Is it half full?", LAB, ("half",), ()),
        ("Is it half full and metal?", LAB, ("half", "metal"), ()),
        ("half, full", LAB, ("empty", "half", "full"), ((0, 1, 2),)),
        ("What color is it?", ROC36, ("brown", "green", "blue"), ((0, 1, 2),)),
        ("Is the color red?", ROC36, ("brown",), ()),
        ("Is it heavy, and what are its contents?", ROC36, ("heavy", *CONTENT), ((1, 2, 3, 4),)),
        ("Is it heavy, and is it red?", ROC36, ("heavy", "brown"), ()),
    ],
)
def test_questions_about_groups(question, domain, attributes, groups):
    query = read_query(question, domain)
    assert (query.attributes, query.groups) == (attributes, groups)


@pytest.mark.parametrize(
    "groups",
    [{"a": ["metal"]}, {"a": ["empty", "half"], "b": ["half", "full"]}, {"a": ["half", "half"]}],
)
def test_groups_have_values_of_their_own(groups):
    with pytest.raises(DomainError, match=r"two or more|twice"):
        load_domain(CUP | {"groups": groups})


@pytest.mark.parametrize("row", [[1, 1, 0, 1], [0, 0, 0, 0], [-1, 1, 1, -1]])
def test_data_with_other_than_one_value_of_a_group_are_refused(row):
    features = {
        (behavior.name, modality): np.zeros((2, 1, 3))
        for behavior in LAB.behaviors
        for modality in behavior.modalities
    }
    Dataset(LAB, ("cup", "jar"), features, [[1, 0, 1, 0], [0, -1, -1, 0]])
    with pytest.raises(DataError, match=r"'jar' is .* of 'fill' .*exactly one is true"):
        Dataset(LAB, ("cup", "jar"), features, [[1, 0, 1, 0], row])


OWN = domain_of(
    "red", "green", "empty", "half", "full", "can", "will", "look", "kind", "heavy", "water",
    groups={"fill": ["empty", "half", "full"], "colour": ["red", "green"]},
)  # fmt: skip
HOW = [
    "How {} is it?",
    "Can you tell me how {} it is?",
    "Please say how {} this object is.",
    "I wonder how {} it is.",
    "Let me know how {} it is going to be.",
]
OPENINGS = [
    "Can you tell whether it is {}?", "Can it be {}?", "Could it be {}?", "Will it be {}?",
    "Can the robot see if it is {}?", "Does it look {}?", "Did you check if it is {}?",
    "What kind of object is it: {}?", "It can be {}?", "Should it look {}?", "Might it be {}?",
    "Would you say it is {}?", "Can you please look whether it is {}?", "Must it be {}?",
    "Is it going to be {}?", "I wonder whether it is {}.", "Hey robot, is it {} or not?",
    "Tell me whether or not it is {}.", "I'd like to know if it is still {}.",
]  # fmt: skip


@given(st.sampled_from(HOW), st.sampled_from(["empty", "half", "full", "red", "green"]))
def test_how_asks_for_the_value_of_the_group(form, value):
    group = next(name for name, values in OWN.groups.items() if value in values)
    assert read_query(form.format(value), OWN).group_names == (group,)
    with pytest.raises(QueryError, match="must name the value"):
        read_event(form.format(value), OWN)


def test_how_asks_for_an_attribute_where_there_is_no_group():
    assert read_query("How heavy is it?", OWN).attributes == ("heavy",)


@pytest.mark.parametrize(
    "question", ["How much does it weigh?", "What does it weigh?", "Can you weigh it?"]
)
def test_weighing_asks_for_the_weight(question):
    scales = domain_of("light", "heavy", groups={"weight": ["light", "heavy"]})
    assert read_query(question, scales).group_names == ("weight",)


@pytest.mark.parametrize("word", ["color", "colour", "colors"])
def test_a_group_is_asked_for_in_either_spelling(word):
    assert read_query(f"What {word} is it?", OWN).group_names == ("colour",)


@given(st.sampled_from(OPENINGS), st.sampled_from(["heavy", "a can", "full", "red", "water"]))
def test_a_verb_names_no_attribute(form, thing):
    asked = (thing.removeprefix("a "),)
    assert read_query(form.format(thing), OWN).attributes == asked
    assert read_event(form.format(thing), OWN).attributes == asked


@pytest.mark.parametrize(
    ("question", "attributes"),
    [
        ("Is it a can?", ("can",)),
        ("Is it can?", ("can",)),
        ("red can", ("red", "can")),
        ("can, heavy", ("can", "heavy")),
        ("Is it a red can and heavy?", ("red", "can", "heavy")),
        ("Is it a can you can look at?", ("can",)),
        ("Is it kind?", ("kind",)),
        ("Is it heavy and can it hold water?", ("heavy", "water")),
    ],
)
def test_a_noun_that_is_a_verb_elsewhere_is_an_attribute(question, attributes):
    assert read_query(question, OWN).attributes == attributes


@given(st.permutations(["empty", "half", "full"]), st.permutations(["red", "green"]))
def test_values_of_a_group_in_another_order_are_the_same_problem(fill, colour):
    domain = domain_of(*OWN.attributes, groups={"fill": fill, "colour": colour})
    assert domain == OWN
    assert read_query("fill, colour", domain) == read_query("fill, colour", OWN)
