#!/usr/bin/env bash
# Set up .venv in this folder: `scripts/setup.sh` to run, `scripts/setup.sh test` to test as well,
# `scripts/setup.sh bench` to measure against other programs.
# Safe to repeat; once all is there it returns at once. PYTHON=... chooses the interpreter.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

kind=${1:-run}
venv=.venv
python=$venv/bin/python
log=$(mktemp)
trap 'rm -f "$log"' EXIT

say() { printf '[setup] %s\n' "$*"; }

fail() {
  printf '[setup] error: %s\n' "$*" >&2
  exit 1
}

# Runs a command quietly; what it printed is shown when it fails.
quietly() {
  "$@" >"$log" 2>&1 || {
    tail -n 30 "$log" >&2
    return 1
  }
}

fits() { "$1" -c 'import sys; sys.exit(not (3, 10) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null; }

find_python() {
  local name
  for name in ${PYTHON:-python3 python3.13 python3.12 python3.11 python3.10}; do
    if fits "$name"; then
      echo "$name"
      return
    fi
  done
  fail "no Python 3.10 to 3.13 (${PYTHON:-python3}): apt-get install python3, or set PYTHON=/path/to/python3"
}

# Installs Debian packages; fails where there is no apt-get or no right to use it.
apt_install() {
  command -v apt-get >/dev/null || return 1
  local root=()
  if [ "$(id -u)" -ne 0 ]; then
    command -v sudo >/dev/null || return 1
    [ -t 0 ] || sudo -n true 2>/dev/null || return 1
    root=(sudo)
  fi
  quietly "${root[@]}" apt-get update -qq || return 1
  quietly "${root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@"
}

make_venv() {
  local base version
  base=$(find_python)
  version=$("$base" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
  if ! "$base" -c 'import ensurepip, venv' 2>/dev/null; then
    say "Python $version can't make virtual environments yet: installing python$version-venv"
    apt_install "python$version-venv" ||
      fail "type: sudo apt-get install python$version-venv   and start again"
  fi
  say "making $venv with Python $version"
  rm -rf "$venv"
  quietly "$base" -m venv "$venv" || fail "no virtual environment could be made"
}

install_packages() {
  local file=requirements.txt
  [ "$kind" != test ] || file=requirements-test.txt
  say "installing $file (a minute or two)"
  quietly "$python" -m pip install --disable-pip-version-check --progress-bar off -r "$file" ||
    fail "pip could not install $file: is there a network, and room on the disk?"
  # The folder itself, so that `python -m herringbone_sim` works from anywhere.
  pwd >"$("$python" -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/herringbone_sim.pth"
}

# Each peer on its own, as some are built from source: what does not install is named, and the
# benchmarks go on without it. Returns 1 when one is missing.
install_peers() {
  local peer result=0
  for peer in $(sed 's/#.*//; /^-/d; s/ //g' requirements-bench.txt requirements-bench-built.txt); do
    if "$python" -m pip install --disable-pip-version-check --progress-bar off "$peer" >"$log" 2>&1; then
      say "installed $peer"
    else
      say "not installed: $peer ($(grep -i error "$log" | tail -n 1)); the benchmarks go on without it"
      result=1
    fi
  done
  return $result
}

have_vulkan() {
  compgen -G '/usr/share/vulkan/icd.d/*.json' >/dev/null || compgen -G '/etc/vulkan/icd.d/*.json' >/dev/null
}

install_vulkan() {
  have_vulkan && return
  say "installing mesa-vulkan-drivers: the Rerun viewer draws with Vulkan"
  apt_install mesa-vulkan-drivers ||
    say "warning: no Vulkan driver, so there will be no pictures of the viewer; all else works." \
      "Type: sudo apt-get install mesa-vulkan-drivers"
}

warm_up() {
  say "compiling the kernel (once)"
  quietly "$python" - <<'PYTHON' || fail "the kernel could not be compiled"
import warnings

import numpy as np

from herringbone_sim.core.batch import run_batch
from herringbone_sim.core.integrate import warm_up
from herringbone_sim.core.model import build
from herringbone_sim.core.parameters import Parameters

warnings.simplefilter("ignore")
for name in ("reduced", "full"):
    model = build(Parameters(model=name))
    warm_up(model)
    even, uneven = np.zeros(model.layout.n_state), np.eye(1, model.layout.n_state)[0]
    run_batch([model] * 2, np.array([even, uneven]), transient=0, cycles=1, points=0)
PYTHON
}

digest() { cat "$@" | sha256sum | cut -d ' ' -f 1; }

# Whether a stage was done for exactly these contents: `done_for STAMP DIGEST`.
done_for() { [ -x "$python" ] && [ "$(cat "$venv/$1.stamp" 2>/dev/null)" = "$2" ]; }

case $kind in
  run | test | bench) ;;
  *) fail "usage: scripts/setup.sh [run|test|bench]" ;;
esac

packages=$(digest requirements*.txt scripts/setup.sh <(pwd))
kernel=$(digest herringbone_sim/core/*.py herringbone_sim/core/lanes/*.py <(pwd))
if ! done_for "$kind" "$packages"; then
  "$python" -m pip --version >/dev/null 2>&1 && fits "$python" || make_venv
  install_packages
  install_vulkan
  echo "$packages" >"$venv/run.stamp"
  if [ "$kind" != bench ] || install_peers; then echo "$packages" >"$venv/$kind.stamp"; fi
fi
if ! done_for kernel "$kernel"; then
  warm_up
  echo "$kernel" >"$venv/kernel.stamp"
fi
say "ready: .venv"
