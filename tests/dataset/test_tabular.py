"""Results show as text in a terminal and as tables in a notebook, and become DataFrames."""

import math
import pickle
import re

import numpy as np
import pytest

import ibdata
from ibdata.dataset.tabular import MOST_ROWS, Table, as_html, as_text, column_texts


def cells(html):
    """The texts of the cells of all tables in HTML."""
    return re.findall(r"<td[^>]*>(.*?)</td>", html)


def test_a_long_table_is_cut_and_says_so():
    table = Table(("n", "values"), [(i, list(range(i))) for i in range(MOST_ROWS + 1234)], ["a note"])
    lines = as_text(table).split("\n")
    assert len(lines) == 1 + MOST_ROWS + 2
    assert lines[-2:] == ["and 1,234 more", "a note"]
    assert lines[12].endswith("[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, … 11 in all]")
    assert len(cells(as_html([table]))) == 2 * MOST_ROWS
    assert "<p>and 1,234 more</p>" in as_html([table])


NUMBERS = [(92 / 3, -1e-9, 50.0), (-11 / 13, 0.0, 12.5), (None, math.nan, 7)]


def test_the_numbers_of_a_column_have_the_same_decimals():
    """A setpoint is shown in full, and no zero has a sign."""
    table = Table(("score", "nothing", "setpoint"), NUMBERS)
    expected = [["30.6667", "-1e-09", "50.0"], ["-0.8462", "0", "12.5"], ["–", "nan", "7"]]
    assert [line.split() for line in as_text(table).split("\n")[1:]] == expected
    assert cells(as_html([table])) == [text for row in expected for text in row]
    assert as_html([table]).count("text-align: right") == 3 * 4
    assert column_texts([4e5 / 3, -1e-5 / 3]) == ["133,333.3333", "0.0000"]


def test_texts_of_a_dataset_can_forge_neither_lines_nor_html():
    table = Table(("name",), [("<b>\n\x1b[1m",)], ["<i>\nsafe"])
    assert as_text(table) == "name\n<b>\\n\\x1b[1m\n<i>\\nsafe"
    assert cells(as_html([table])) == ["&lt;b&gt;\\n\\x1b[1m"]
    assert "<i>" not in as_html([table])


def test_statistics_of_a_column_say_of_how_many_rows_they_are(describe, made_at, tmp_path):
    """The density of a function is not known."""
    policies = [lambda seen: seen[:, 1:4] / 100.0, {"kind": "random"}, {"kind": "safe"}]
    dataset = made_at(describe(policies=policies, output={"shard_rows": 40}), tmp_path / "made")
    assert ibdata.validate(dataset) == []
    known = dataset.select(policy=["random", "safe"]).table(["action_log_prob"])["action_log_prob"].to_numpy()
    for columns in (dataset.statistics(), dataset.select(episodes=range(18)).statistics()):
        found = columns["action_log_prob"]
        assert (found["count"], found["min"], found["max"]) == (480, known.min(), known.max())
        assert found["mean"] == pytest.approx(known.mean(dtype=float), rel=1e-12)
        assert found["quantiles"]["0.5"] == np.quantile(known, 0.5, method="inverted_cdf")
        assert columns["reward"]["count"] == 720
        assert repr(columns).endswith("\naction_log_prob: of the 480 of 720 rows that have a number")


def test_a_dataset_shows_what_it_holds_and_its_splits(dataset, moving):
    shown = cells(dataset._repr_html_())
    assert shown[:5] == ["small", "480", "12", "[random, calm]", "[20, 70]"]
    assert shown[5] == f"{dataset.content_root[:12]}…"
    assert shown[7:] == ["source", "6", "240", "whole files", "target", "4", "160", "whole files"]
    assert repr(dataset.splits).split("\n")[0].split() == ["split", "episodes", "rows", "kind"]
    assert dataset.splits.to_pandas()["rows"].tolist() == [240, 160]
    assert "<p>no splits</p>" in moving._repr_html_()
    assert (repr(moving.splits), moving.splits) == ("no splits", {})


def test_the_problems_are_a_list_and_a_table(copied):
    fine = ibdata.validate(copied)
    assert (fine, repr(fine)) == ([], "no problems")
    assert list(fine.to_pandas().columns) == ["path", "row", "rule", "message"]
    (copied / "meta/statistics.json").write_text("other")
    found = ibdata.validate(copied)
    assert isinstance(found, list)
    assert found.to_pandas()["rule"].tolist() == [problem.rule for problem in found] == ["hash"]
    assert cells(found._repr_html_())[:3] == ["meta/statistics.json", "–", "hash"]
    assert "meta/statistics.json" in repr(found)
    assert pickle.loads(pickle.dumps(found)) == found
