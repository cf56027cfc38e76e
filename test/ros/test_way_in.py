"""The way in of a ROS user, as its page has it."""

from __future__ import annotations

import re

from ways_in import ROOT, run_page


def test_a_ros_user_steers_and_records(tmp_path, domain, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    printed = run_page(ROOT / "docs" / "start" / "ros.md", tmp_path, 600)
    # Which period K first finds depends on when it comes to the chaotic motion.
    assert re.search(r"K = [.\d]+: P\d+, exponent", printed)
    assert re.search(r"P from K = [.\d]+; lost again at K = [.\d]+", printed)
    assert re.search(r"^ +\d.* P\d+ ", printed, re.MULTILINE)
    assert (tmp_path / "first_runs" / "steered" / "metadata.yaml").exists()
    assert (tmp_path / "first_runs" / "analysis" / "report.html").exists()
