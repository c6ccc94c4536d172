"""The flat problem is the factored one, and what written .pomdp files hold."""

from dataclasses import replace

import numpy as np
import pytest
from planner_models import load_reference

from meal_bayes.domain import Behavior, Domain, Effect, Query, TransitionDiagram, load_domain
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import (
    FlatPOMDP,
    Transition,
    build_momdp,
    flatten,
    initial_belief,
    percept_probabilities,
    update_belief,
    write_pomdp,
)


def read_pomdp(path) -> FlatPOMDP:
    """Read what is written, by the authors too: a statement a line, one entry or * for all."""
    words = {}
    tables = {}
    for line in path.read_text().splitlines():
        keyword, *rest = line.partition("#")[0].split(":")
        if keyword in ("T", "O", "R"):
            if not tables:
                names = [words[k] for k in ("actions", "states", "observations")]
                a, s, z = map(len, names)
                kinds = {"T": (0, 1, 1), "O": (0, 1, 2), "R": (0, 1)}
                shapes = {"T": (a, s, s), "O": (a, s, z), "R": (a, s)}
                tables = {key: np.zeros(shape) for key, shape in shapes.items()}
            *places, last = (part.split() for part in rest)
            place = [word for part in (*places, last[:-1]) for word in part]
            index = tuple(
                slice(None) if word == "*" else names[kind].index(word)
                for word, kind in zip(place, kinds[keyword], strict=False)
            )
            assert place[2:] == ["*", "*"] or keyword != "R"
            tables[keyword][index] = float(last[-1])
        elif keyword.strip():
            words[keyword] = rest[0].split()
    assert words["values"] == ["reward"]
    for rows in (tables["T"], tables["O"]):  # the authors' files have 12 digits
        np.testing.assert_allclose(rows.sum(axis=-1), 1.0, atol=1e-9)
    return FlatPOMDP(
        tuple(words["states"]), tuple(words["actions"]), tuple(words["observations"]),
        tables["T"], np.broadcast_to(tables["O"][:, None], (a, s, s, z)), tables["R"].T,
        np.array(words["start"], dtype=float), float(words["discount"][0]),
    )  # fmt: skip


def written(momdp, folder, **options) -> FlatPOMDP:
    write_pomdp(momdp, folder / "own.pomdp", **options)
    return read_pomdp(folder / "own.pomdp")


@pytest.mark.parametrize("name", ["A1", "A2", "A3"])
def test_reference_models_equal_the_authors_files(reference, tmp_path, name):
    """But for illegal behaviors: theirs may end a trial by one, at its cost."""
    momdp = replace(load_reference()[name], abstain=False)
    ours = written(momdp, tmp_path)
    theirs = read_pomdp(reference / f"roc36_{name}.pomdp")
    illegal = np.nonzero(np.repeat(~momdp.legal[:-1], 2 ** len(momdp.query), axis=0))
    np.testing.assert_array_equal(theirs.reward[illegal], -momdp.cost[illegal[1]])
    reward = theirs.reward.copy()
    reward[illegal] = ours.reward[illegal]
    theirs = replace(theirs, reward=reward)
    for field in ("state_names", "action_names", "observation_names", "discount"):
        assert getattr(ours, field) == getattr(theirs, field)
    for field in ("transition", "observation", "reward", "start"):  # theirs have 12 digits
        np.testing.assert_allclose(getattr(ours, field), getattr(theirs, field), atol=2e-12)


@pytest.mark.parametrize(
    ("name", "n", "levels"),
    [("toy", 1, 2), ("toy", 2, 4), ("roc36", 2, 2), ("ispy32", 2, 2), ("cy101", 1, 4)],
)
def test_what_is_written_is_the_flat_problem(momdp_of, tmp_path, name, n, levels):
    momdp = momdp_of(name, n, levels)
    bonus = np.random.default_rng(1).uniform(-9, 9, momdp.bonus.shape)
    momdp = replace(momdp, bonus=bonus)
    ours = written(momdp, tmp_path)
    flat = flatten(momdp)
    for field in ("transition", "reward", "start"):
        np.testing.assert_allclose(getattr(ours, field), getattr(flat, field), atol=1e-15)
    assert ours.discount == flat.discount
    percepts = np.where(flat.transition[..., None] > 0, flat.observation, 0.0)
    both = np.where(flat.transition[..., None] > 0, ours.observation, 0.0)
    np.testing.assert_allclose(both[..., :-2], percepts[..., :-1], atol=1e-15)
    np.testing.assert_allclose(both[..., -2:].sum(-1), percepts[..., -1], atol=1e-15)


@pytest.mark.parametrize("name", ["toy", "roc36", "ispy32", "cy101"])
def test_every_observation_tells_x(momdp_of, tmp_path, name):
    """From a state whose x is known, the x of the next is known, whatever is observed."""
    momdp = momdp_of(name, 1)
    ours = written(momdp, tmp_path)
    end = momdp.terminal
    x_of = np.append(np.repeat(np.arange(end), 2), end)
    reached = ours.transition[..., None] * ours.observation > 0  # (A,S,S,Z)
    at = np.stack([reached[:, :, x_of == x].any(axis=2) for x in range(end + 1)])  # (X,A,S,Z)
    assert at.sum(axis=0).max() == 1
    reinit = momdp.behavior_names.index("reinit")
    assert ours.observation_names[-2:] == ("na", "done")
    assert (ours.observation[reinit, :, 0, -1] == 1).all()  # back at x0


@pytest.mark.parametrize(
    ("effects", "message"),
    [
        (
            [("x0", "look", "x1"), ("x1", "look", "x1", 0.5), ("x0", "go", "x2")],
            r"'look' arrives at 'x1' from \['x0', .* with a percept in .*% to 100%",
        ),
        (
            [("x0", "look", "x1", 0.5), ("x0", "look", "x2", 0.5)],
            "'look' in 'x0' leads to 'x1' or 'x2' with the same observation",
        ),
        (
            [("x0", "go", "x1", 0.5), ("x0", "go", "x2", 0.3), ("x1", "look", "x1")],
            "'go' in 'x0' leads to 'x1' or 'x2' with the same observation",
        ),
    ],
)
def test_what_a_file_cannot_hold_is_told(tmp_path, effects, message):
    states = ("x0", "x1", "x2", "term")
    names = sorted({behavior for _, behavior, *_ in effects})
    diagram = TransitionDiagram(states, "x0", tuple(Effect(*effect) for effect in effects))
    behaviors = tuple(Behavior(n, 1.0, ("color",) if n == "look" else ()) for n in names)
    rows = np.tile([[0.8, 0.2], [0.3, 0.7]], (1, len(names), 1, 1))
    momdp = build_momdp(Domain("own", ("red",), behaviors, diagram), Query(("red",)), rows)
    with pytest.raises(SettingsError, match=message):
        write_pomdp(momdp, tmp_path / "own.pomdp")
    assert list(tmp_path.iterdir()) == []


def test_odd_names_become_identifiers(tmp_path):
    names = (
        "T",
        "lift it!",
        "lift\nit?",
        "a0",
        "reward",
        "9",
        "heb\N{LATIN SMALL LETTER E WITH ACUTE}",
    )
    domain = Domain(
        "own",
        ("red\n states: x",),
        tuple(Behavior(name, 1.0, ("sight",)) for name in names),
        TransitionDiagram(
            ("x\n0: #", "term"), "x\n0: #", tuple(Effect("*", name, "*") for name in names)
        ),
    )
    momdp = build_momdp(domain, Query(domain.attributes), np.full((1, 7, 2, 2), 0.5))
    read_back = written(momdp, tmp_path)
    assert read_back.action_names == (
        "T_", "lift_it_", "lift_it__", "a0_", "reward_", "n9", "heb_", "a0", "a1",
    )  # fmt: skip
    text = (tmp_path / "own.pomdp").read_text()
    assert text.startswith("# query: red states: x?\n# s0: x 0: #\n")
    np.testing.assert_array_equal(read_back.transition, flatten(momdp).transition)


def test_tiny_probabilities_have_digits_on_both_sides_of_the_point(momdp_of, tmp_path):
    momdp = momdp_of("toy", 1)
    rows = momdp.confusion.copy()
    rows[0, 0] = [[1 - 1e-7, 1e-7], [3e-12, 1 - 3e-12]]
    read_back = written(replace(momdp, confusion=rows), tmp_path)
    assert "e-" not in (tmp_path / "own.pomdp").read_text()
    np.testing.assert_array_equal(read_back.observation[0, 0, 0, :2], rows[0, 0, 0])
    np.testing.assert_array_equal(read_back.observation[0, 0, 1, :2], rows[0, 0, 1])


@pytest.mark.parametrize(
    ("name", "n", "levels", "states", "observations"),
    [
        ("ispy32", 2, 2, 25, 5), ("ispy32", 3, 2, 49, 9), ("roc36", 2, 4, 25, 17),
        ("roc36_published", 3, 2, 49, 9), ("cy101", 1, 2, 11, 3), ("cy101", 2, 2, 21, 5),
    ],
)  # fmt: skip
def test_sizes_and_distributions(momdp_of, name, n, levels, states, observations):
    momdp = momdp_of(name, n, levels)
    flat = flatten(momdp)
    assert len(flat.state_names) == len(set(flat.state_names)) == states == momdp.n_states
    assert len(flat.observation_names) == observations
    assert len(flat.action_names) == momdp.n_actions
    for rows in (flat.transition, flat.observation):
        assert (rows >= 0).all()
        np.testing.assert_allclose(rows.sum(axis=-1), 1.0)
    assert flat.start.sum() == pytest.approx(1.0)
    assert (flat.start > 0).sum() == 2**n


@pytest.mark.parametrize("name", ["toy", "ispy32", "roc36_published"])
@pytest.mark.parametrize("levels", [2, 4])
def test_the_dense_filter_is_the_factored_filter(momdp_of, name, levels):
    momdp = momdp_of(name, 2, levels)
    flat = flatten(momdp)
    rng = np.random.default_rng(1)
    for _ in range(30):
        belief = initial_belief(momdp)
        dense = flat.start
        truth = rng.integers(4)
        while belief.x != momdp.terminal and belief.percept_counts.sum() < 10:
            action = int(rng.choice(np.flatnonzero(momdp.legal[belief.x])))
            next_x = int(rng.choice(momdp.terminal + 1, p=momdp.transition[action, belief.x]))
            comes = rng.random() < momdp.observation_probability[action, belief.x, next_x]
            z = rng.choice(levels**2, p=percept_probabilities(momdp, action)[truth])
            percept = np.array(divmod(z, levels), dtype=np.int8) if comes else None
            z = z if comes else -1
            belief = update_belief(belief, momdp, Transition(action, next_x, percept))
            joint = dense[:, None] * flat.transition[action] * flat.observation[action, :, :, z]
            # x is observed: only states of the next x stay possible.
            at_next = np.zeros(momdp.n_states)
            at_next[next_x * 4 : min(next_x * 4 + 4, momdp.n_states)] = 1.0
            dense = joint.sum(axis=0) * at_next
            dense /= dense.sum()
            if next_x != momdp.terminal:
                np.testing.assert_allclose(dense[next_x * 4 : next_x * 4 + 4], belief.joint)


def test_rewards_are_equation_4(momdp_of):
    momdp = momdp_of("toy", 2)
    flat = flatten(momdp)
    e = momdp.n_behaviors
    legal = np.repeat(momdp.legal[:-1], 4, axis=0)
    costs = np.where(legal, [-1.0, -5.0, -2.0], [-102.0, -106.0, -103.0])  # below every report
    np.testing.assert_array_equal(flat.reward[:-1, :e], costs)
    for state in range(8):
        expected = np.where(np.arange(4) == state % 4, 100.0, -100.0)
        np.testing.assert_array_equal(flat.reward[state, e:], expected)
    assert not flat.reward[-1].any()
    np.testing.assert_array_equal(flat.transition[e:, :, -1], 1.0)


def test_abstaining_is_the_last_action_and_worth_nothing(momdp_of):
    momdp = replace(momdp_of("toy", 2), abstain=True)
    flat = flatten(momdp)
    assert flat.action_names[-1] == "abstain"
    assert not flat.reward[:, -1].any()
    assert (flat.transition[-1, :, -1] == 1).all()


def test_what_does_not_fit_is_refused(momdp_of, tmp_path):
    with pytest.raises(SettingsError, match="precision=inf"):
        write_pomdp(momdp_of("toy", 1, precision=4.0), tmp_path / "a.pomdp")
    with pytest.raises(SettingsError, match="5 attributes"):
        flatten(momdp_of("ispy32", 5))
    with pytest.raises(SettingsError, match="precision=inf"):
        flatten(momdp_of("toy", 1, precision=4.0))
    latent_classes = np.full((1, 2, 4), 0.25)
    rows = np.full((1, 3, 4, 2), 0.5)
    with pytest.raises(SettingsError, match="latent_classes"):
        flatten(
            build_momdp(load_domain("toy"), Query(("red",)), rows, latent_classes=latent_classes)
        )


def test_the_file_says_which_attribute_each_digit_is_of(tmp_path):
    domain = load_domain("roc36")
    rows = np.full((4, len(domain.behaviors), 2, 2), 0.5)
    query = Query(("heavy", "brown", "green", "blue"), ((1, 2, 3),), ("color",))
    write_pomdp(build_momdp(domain, query, rows), tmp_path / "own.pomdp")
    lines = (tmp_path / "own.pomdp").read_text().splitlines()
    assert "# digits behind p, 1 true and 0 false: heavy, brown, green, blue" in lines
    states = next(line for line in lines if line.startswith("states:")).split()
    assert states[1] == "s0p0100"  # the first values: not heavy, brown
    assert query.report_name(query.values[0]) == "not heavy, brown"
