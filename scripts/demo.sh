#!/usr/bin/env bash
# Set up, then do the main job once; results in demo/. Arguments go to the demo: --help shows them.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

bash scripts/setup.sh
export ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST
exec .venv/bin/python -m herringbone_sim demo --out demo --force "$@"
