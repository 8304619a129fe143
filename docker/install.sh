#!/usr/bin/env bash
# Installs mpcplan with pinned dependencies into a virtual environment. The Dockerfile and
# .ci/container both call this script, so that what is tested without Docker is what an image holds.
#
#   docker/install.sh dependencies VENV SUMO   create VENV, install all that is pinned
#   docker/install.sh package VENV SUMO        install the package into it, check that nothing
#                                              is in VENV that is not pinned
#   docker/install.sh pin VENV SUMO            pin anew: the newest versions that pyproject.toml
#                                              allows with this SUMO, in a scratch environment VENV
#
# The interpreter is $INTERPRETER (default: python3). The versions are in
# requirements/python<X.Y>-sumo<SUMO>.txt, one "name==version" a line, pip and setuptools included.
set -euo pipefail

step=${1:?step missing: dependencies, package or pin}
venv=${2:?folder of the virtual environment missing}
sumo=${3:?version of SUMO missing, for example 1.28.0}

source=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
interpreter=${INTERPRETER:-python3}
python_version=$("$interpreter" -c 'import sys; print("%d.%d" % sys.version_info[:2])')
pins="$source/requirements/python$python_version-sumo$sumo.txt"
tools=(pip setuptools wheel)
export PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_NO_CACHE_DIR=1 PIP_ROOT_USER_ACTION=ignore

pip() { "$venv/bin/python" -m pip "$@"; }

# Installs the package with the given options, built from a copy: the build leaves files behind.
package_from_copy() {
    local copy status=0
    copy=$(mktemp -d)
    cp -R "$source"/{pyproject.toml,README.md,LICENSE,mpcplan} "$copy"
    pip install --quiet "$@" "$copy" || status=$?
    rm -rf "$copy"
    return "$status"
}

# What is installed, the package itself left out.
installed() { pip freeze --all | grep -vE '^(mpcplan @|-e )' | LC_ALL=C sort -f; }

dependencies() {
    if [[ ! -f $pins ]]; then
        echo "nothing is pinned for Python $python_version with SUMO $sumo; there are:" >&2
        ls "$source/requirements" >&2
        echo "'docker/install.sh pin VENV $sumo' pins another pair" >&2
        return 1
    fi
    "$interpreter" -m venv --clear "$venv"
    pip install --quiet --constraint "$pins" "${tools[@]}"
    # what comes as source is built with the pinned tools too
    pip install --quiet --no-build-isolation --requirement "$pins"
}

package() {
    package_from_copy --no-build-isolation --no-deps
    pip check
    if ! diff "$pins" <(installed); then
        echo "the environment differs from $pins: pin anew" >&2
        return 1
    fi
}

pin() {
    "$interpreter" -m venv --clear "$venv"
    pip install --quiet --upgrade "${tools[@]}"
    # SUMO's own packages ask for "at least": hold them at one version
    package_from_copy --constraint <(printf '%s\n' {libsumo,traci,sumolib,sumo-data}=="$sumo")
    pip check
    installed >"$pins"
    echo "wrote $pins"
}

case $step in
dependencies | package | pin) "$step" ;;
*)
    echo "unknown step $step: dependencies, package or pin" >&2
    exit 2
    ;;
esac
