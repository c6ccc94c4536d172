import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from meal_bayes.domain import Query, load_domain, read_query
from meal_bayes.errors import QueryError

ROC36, ISPY32, CY101 = (load_domain(name) for name in ("roc36", "ispy32", "cy101"))


@pytest.mark.parametrize(
    ("question", "domain", "attributes"),
    [
        ("Is it heavy, and does it hold beans?", ROC36, ("heavy", "beans")),
        ("Is this container green?", ROC36, None),
        ("is it RED and empty?", ROC36, None),
        ("Is it RED and does it contain screws?", ROC36, ("brown", "screws")),
        ("heavy, beans", ROC36, ("heavy", "beans")),
        ("heavy", ROC36, ("heavy",)),
        ("It's light, isn't it?", ROC36, None),
        ("What's its weight: heavy?", ROC36, ("heavy",)),
        (["Heavy", " red "], ROC36, ("heavy", "brown")),
        (("blue",), ROC36, ("blue",)),
        ("Is it pencil-shaped and 'half-full' of water?", ISPY32,
         ("pencil-shaped", "half-full", "water")),
        ("Is the object heavy and metallic?", ISPY32, ("heavy", "metallic")),
        ("Is this thing colored?", ISPY32, ("colored",)),
        ("Is it a thing?", ISPY32, ("thing",)),
        ("object, thing", ISPY32, ("object", "thing")),
        ("Is it a plastic container?", CY101, ("plastic", "container")),
        ("Is it soft \N{EM DASH} or hard?", CY101, ("soft", "hard")),
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
        (["heavy", "heavy"], "names 'heavy' twice"),
        ("Is it not heavy?", "says 'not'; ask the plain attribute"),
        ("Isn't it heavy?", 'says "isn\'t"; ask the plain attribute'),
        ("is it without beans", "says 'without'"),
        ("", "No attribute found in ''; expected some of: light"),
        ("What is it?", "No attribute found"),
        ([], "names no attribute; name at least one"),
        ([""], "Unknown attribute ''"),
    ],
)
def test_bad_questions_teach_in_one_line(question, says):
    with pytest.raises(QueryError, match=says) as caught:
        read_query(question, ROC36)
    assert "\n" not in str(caught.value)


def test_case_of_own_attributes_does_not_matter(tmp_path):
    table = (
        'name = "mine"\nattributes = ["Red", "Very Heavy"]\n'
        'behaviors = [{ name = "look", cost = 1 }]\n'
        '[diagram]\nstates = ["x"]\nstart = "x"\neffects = [{ from = "x", do = "look", to = "x" }]'
    )
    path = tmp_path / "mine.toml"
    path.write_text(table)
    domain = load_domain(path)
    assert read_query("is it red and VERY heavy?", domain).attributes == ("Red", "Very Heavy")


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
