#!/usr/bin/env bash
# Makes .venv-clients: the client libraries of the makers of controllers, which need Python 3.12 or
# newer. Without one, a sentence; their tests are then skipped.
set -euo pipefail
cd "$(dirname "$0")/.."

wanted=$(sha256sum requirements-clients.txt)
[ "$(cat .venv-clients/.ready 2>/dev/null)" = "$wanted" ] && exit
shims=$(command -v python3.12 || true)
for python in python3.14 python3.13 python3.12 "${shims%/shims/*}"/versions/3.1[2-9]*/bin/python; do
  if "$python" -c 'import sys, venv; sys.exit(sys.version_info < (3, 12))' 2>/dev/null; then
    "$python" -m venv --clear .venv-clients
    if ! .venv-clients/bin/python -I -m pip install -q --disable-pip-version-check \
      -r requirements-clients.txt; then
      echo 'clients of the makers could not be installed, see above; their tests are skipped'
      rm -rf .venv-clients
      exit
    fi
    echo "$wanted" >.venv-clients/.ready
    exit
  fi
done
echo 'clients of the makers are not installed: no Python 3.12 was found; their tests are skipped'
