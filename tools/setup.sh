#!/usr/bin/env bash
# Sets Handrail up on a fresh Debian 12: system packages, the virtual environment from the lock file, and the package itself.
# System packages are installed when this runs as root; otherwise the exact command is printed and the script stops.
set -euo pipefail
PYTHON=${PYTHON:-python3}
VENV=${VENV:-.venv}

"$PYTHON" - <<'PY'
import sys
if sys.version_info[:2] != (3, 11):
    sys.exit(f"Handrail needs Python 3.11 (PyBullet has wheels for no newer one); {sys.executable} is {sys.version.split()[0]}. "
             "Run: make PYTHON=/path/to/python3.11")
PY

# The window's libraries (Qt on a real or virtual screen), fonts, Graphviz (pictures of programs), OpenMP, and venv where Debian splits it off.
PACKAGES="xvfb xauth libegl1 libgl1 libgl1-mesa-dri libfontconfig1 libdbus-1-3 libglib2.0-0 libgssapi-krb5-2
  libxkbcommon-x11-0 libxcb-cursor0 libxcb-icccm4 libxcb-image0 libxcb-keysyms1 libxcb-randr0 libxcb-render-util0
  libxcb-shape0 libxcb-xinerama0 libxcb-xkb1 libxtst6 fonts-dejavu-core graphviz libgomp1"
"$PYTHON" -c 'import ensurepip, venv' 2>/dev/null || PACKAGES="$PACKAGES python3-venv"

if command -v dpkg-query >/dev/null; then
  missing=""
  for package in $PACKAGES; do
    dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q 'install ok installed' || missing="$missing $package"
  done
  if [ -n "$missing" ]; then
    if [ "$(id -u)" = 0 ]; then
      echo "installing system packages:$missing"
      apt-get update -qq
      # shellcheck disable=SC2086
      DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $missing
    else
      echo "These system packages are missing. Install them, then run make again:" >&2
      echo "  sudo apt-get update && sudo apt-get install -y --no-install-recommends$missing" >&2
      exit 1
    fi
  fi
else
  echo "not a Debian system: make sure that your system's equivalents of these are installed: $PACKAGES" >&2
fi

[ -x "$VENV/bin/python" ] || "$PYTHON" -m venv "$VENV"
PIP="$VENV/bin/python -m pip --quiet --disable-pip-version-check --no-input"

# uv installs the same locked files in a quarter of pip's time, but does not read pip's configuration: which index to ask is passed on
# here. Where uv is not to be had or fails, and where packages come from a folder, pip installs them.
SETTINGS=$($PIP config list)
from_pip() { # one of pip's options → its value, the environment's before the files'
  sed -n "s/^\(:env:\|install\|global\)\.$1='\(.*\)'\$/\2/p" <<<"$SETTINGS" | head -1
}
with_uv() (
  [ -z "$(from_pip no-index)" ] || return
  $PIP install --require-hashes -r <(awk '/^[a-z]/ { wanted = /^uv==/ } wanted' requirements.lock) || return
  pass() { local value; value=$(from_pip "$2"); [ -z "$value" ] || export "$1=$value"; }
  pass UV_DEFAULT_INDEX index-url
  pass UV_INDEX extra-index-url
  pass UV_INSECURE_HOST trusted-host
  pass SSL_CERT_FILE cert
  "$VENV/bin/uv" pip install --quiet --python "$VENV/bin/python" --system-certs --index-strategy unsafe-best-match \
    --no-deps --require-hashes -r requirements.lock
)
with_uv || $PIP install --require-hashes -r requirements.lock
$PIP install --no-deps --no-build-isolation -e .
