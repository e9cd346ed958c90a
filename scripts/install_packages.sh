#!/usr/bin/env bash
# Installs the packages of packages.apt that are missing; says nothing and asks for nothing where none is.
set -euo pipefail
cd "$(dirname "$0")/.."

if ! command -v dpkg-query > /dev/null; then
  echo "This is no Debian or Ubuntu: have these, or what they are called here: $(xargs < packages.apt)" >&2
  exit 0
fi

missing=()
while read -r package; do
  dpkg-query -W -f '${db:Status-Abbrev}' "$package" 2> /dev/null | grep -q '^ii' || missing+=("$package")
done < packages.apt
((${#missing[@]})) || exit 0

as_root=()
if ((EUID != 0)); then
  # A password may be asked for at a terminal, and nowhere else.
  if command -v sudo > /dev/null && { sudo -n true 2> /dev/null || { [ -t 0 ] && sudo -v; }; }; then
    as_root=(sudo)
  else
    echo "These system packages are missing, and installing them needs root. Run this, then the same make again:" >&2
    echo "  sudo apt-get update && sudo apt-get install -y --no-install-recommends ${missing[*]}" >&2
    exit 1
  fi
fi

echo "Installing system packages: ${missing[*]}"
apt=("${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -o DPkg::Lock::Timeout=300 -q)
if ! { "${apt[@]}" update && "${apt[@]}" install -y --no-install-recommends "${missing[@]}"; }; then
  echo "apt-get failed (see above). These packages are missing:" >&2
  echo "  sudo apt-get update && sudo apt-get install -y --no-install-recommends ${missing[*]}" >&2
  exit 1
fi
