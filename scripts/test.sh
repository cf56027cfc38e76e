#!/usr/bin/env bash
# Set up, then run every check and test; the exit code is non-zero when any of them fails.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

bash scripts/setup.sh test
export ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST
export PATH="$PWD/.venv/bin:$PATH"

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
# The settings and the list of fonts of whoever runs this are not those of the tests.
export MPLCONFIGDIR="$work/matplotlib"

# Runs a stage and notes how it went: `stage NAME COMMAND...`.
stage() {
  local name=$1 began=$SECONDS result=ok
  shift
  printf '\n== %s\n' "$name"
  "$@" || { result=FAILED; touch "$work/failed"; }
  printf '%-20s %-7s %5d s\n' "$name" "$result" $((SECONDS - began)) >>"$work/summary.txt"
}

# Each process has a part of the files, as the tests of a file share what is slow to make, and takes
# tests from another once it is done. Only the tests of the folders whose coverage is asked for are
# traced: tracing slows compilation. They have a process more than there are cores, as those of the
# node wait most of the time: it keeps its own.
tests() {
  local result=0
  local traced=(test/core test/recording test/ros test/faults)
  local shared=(--dist worksteal --durations=40)
  python -m pytest -n 2 "${shared[@]}" "${traced[@]/#/--ignore=}" |
    tee "$work/pytest.txt" || result=1
  python -m pytest -n 3 "${shared[@]}" "${traced[@]}" --cov --cov-report= |
    tee -a "$work/pytest.txt" || result=1
  return $result
}

# At least 95 % of the lines of one folder of the package.
covered() { python -m coverage report --include="herringbone_sim/$1/*" --fail-under=95 --skip-covered; }

# A workspace outside the tree, as a ROS user has it.
build() {
  mkdir -p "$work/ws/src/herringbone_sim"
  tar -c --exclude-vcs --exclude=./.venv --exclude=./runs --exclude=./demo --exclude=./build \
    --exclude=./install --exclude=./log --exclude=./site --exclude=./.*_cache . | tar -x -C "$work/ws/src/herringbone_sim"
  (cd "$work/ws" && colcon build)
}

# The whole suite runs by itself; here a part of it shows that colcon finds and reports tests.
colcon_test() {
  (
    cd "$work/ws" &&
      colcon test --return-code-on-test-failure --pytest-args \
        test/project/test_package.py test/project/test_launch.py test/core/test_layout.py test/core/test_parameters.py &&
      colcon test-result --verbose
  )
}

# The installed executable starts in the environment that install/setup.bash makes, and ends.
installed() {
  (cd "$work/ws" && bash "$OLDPWD/scripts/try_installed.sh")
}

# Stages of one process each, in two rows that need nothing of each other.
sources() {
  stage "ruff check" ruff check .
  stage "ruff format" ruff format --check .
  stage "mypy" mypy
  stage "import contracts" lint-imports
  stage "docs site" python -m sphinx -q -W --keep-going -b html docs "$work/site"
}
package() {
  stage "colcon build" build
  stage "colcon test" colcon_test
  stage "installed node" installed
}

package >"$work/package.txt" 2>&1 &
sources
wait $! || touch "$work/failed"
cat "$work/package.txt"
stage "pytest" tests
stage "coverage: core" covered core
stage "coverage: recording" covered recording

printf '\n== summary\n'
cat "$work/summary.txt"
grep -E " (passed|failed).* in " "$work/pytest.txt" || true
[ ! -e "$work/failed" ]
