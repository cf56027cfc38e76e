#!/usr/bin/env bash
# Set up, then build the site of the docs into site/; a warning is an error.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

bash scripts/setup.sh test
.venv/bin/python -m sphinx -q -W --keep-going -b html docs site
echo "written: site/index.html"
