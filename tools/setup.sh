#!/usr/bin/env bash
# Makes the workspace usable: tools checked, .venv filled, interfaces and nodes built.
# Called by the Makefile; a second call finds everything done and returns at once.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

fail() { echo "setup: $*" >&2; exit 1; }

find_python() {
  local candidate
  for candidate in ${PYTHON:-} python3 python3.12 python3.11; do
    if "$candidate" -c 'import sys; sys.exit(sys.version_info[:2] not in ((3, 11), (3, 12)))' \
        2>/dev/null; then
      command -v "$candidate"
      return
    fi
  done
}

check_tools() {
  python=$(find_python)
  [ -n "$python" ] || fail 'Python 3.11 or 3.12 is missing: install python3.12 and python3.12-venv'
  "$python" -c 'import venv, ensurepip' 2>/dev/null ||
    fail "the venv module of $python is missing: install python3-venv"
  command -v cmake >/dev/null || fail 'cmake is missing: install cmake'
  command -v g++ >/dev/null || command -v c++ >/dev/null ||
    fail 'a C++ compiler is missing: install g++'
  command -v gcc >/dev/null || command -v cc >/dev/null ||
    fail 'a C compiler is missing: install gcc'
}

install_with_ros() {  # a sourced ROS 2 Jazzy brings rclpy, the messages and (mostly) colcon
  "$python" -m venv --system-site-packages .venv
  # The messages of a ROS installation are compiled for the numpy 1 of its distribution.
  .venv/bin/pip install -qq --disable-pip-version-check -r requirements.txt 'numpy<2'
  .venv/bin/python -c 'import colcon_core' 2>/dev/null || .venv/bin/pip install -qq \
    --disable-pip-version-check -c constraints-ros.txt colcon-ros colcon-bash colcon-output \
    colcon-package-selection colcon-parallel-executor
}

install_with_wheels() {
  "$python" -m venv .venv
  .venv/bin/pip install -qq --disable-pip-version-check \
    -r requirements.txt -r requirements-ros.txt -c constraints-ros.txt
  .venv/bin/python tools/repair_wheels.py
  cat >.venv/local_setup.bash <<'SETUP'
# Makes the ROS 2 wheels of this virtual environment an underlay that colcon can chain.
_prefix="$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)"
case ":${AMENT_PREFIX_PATH:-}:" in *":$_prefix:"*) ;; *)
  export AMENT_PREFIX_PATH="$_prefix${AMENT_PREFIX_PATH:+:$AMENT_PREFIX_PATH}"
  export CMAKE_PREFIX_PATH="$_prefix${CMAKE_PREFIX_PATH:+:$CMAKE_PREFIX_PATH}"
  export PATH="$_prefix/bin:$PATH" ;;
esac
unset _prefix
SETUP
  sed 's/"${BASH_SOURCE\[0\]}"/"${BASH_SOURCE:-$0}"/' .venv/local_setup.bash >.venv/local_setup.sh
}

stamp_of() { cat "$@" | cksum | cut -d' ' -f1; }

install() {
  local wanted
  wanted="${ROS_DISTRO:-wheels} $(stamp_of requirements*.txt constraints-ros.txt tools/repair_wheels.py)"
  [ "$(cat .venv/.ready 2>/dev/null)" = "$wanted" ] && return
  check_tools
  echo 'setup: installing into .venv (once, about a minute)'
  rm -rf .venv build install log
  if [ "${ROS_DISTRO:-}" = jazzy ]; then install_with_ros; else install_with_wheels; fi
  echo "$wanted" >.venv/.ready
}

build() {
  local wanted
  # What is not a symbolic link in the install space decides; Python sources are linked.
  wanted=$(stamp_of $(find src config -type f \( -path 'src/piezo_interfaces/*' -o -path 'config/*' \
    -o -name 'setup.*' -o -name package.xml -o -path '*/launch/*' \) -not -name '*.pyc' | sort)
    { find config -type f; find src -path "*/launch/*" -o -name __init__.py; } | sort | cksum)
  [ "$(cat install/.built 2>/dev/null)" = "$wanted" ] && return
  echo 'setup: building the workspace with colcon'
  if [ -f .venv/local_setup.bash ]; then set +u; source .venv/local_setup.bash; set -u; fi
  mkdir -p log
  .venv/bin/python -m colcon build --symlink-install --event-handlers console_direct- \
    --base-paths src --cmake-args -DPython3_EXECUTABLE="$PWD/.venv/bin/python" \
    -DBUILD_TESTING=OFF >log/build.txt 2>&1 || { tail -n 40 log/build.txt >&2
    fail 'the build failed; the whole output is in log/build.txt'; }
  echo "$wanted" >install/.built
}

compile_kernels() {  # so that no node or test waits for one; see piezo_kernels
  local wanted machine
  machine=$(grep -m 2 -E '^(model name|flags)' /proc/cpuinfo | cksum)
  wanted="$machine $(stamp_of $(find src/piezo_kernels src/piezo_sim src/piezo_hysteresis \
    -name '*.py' -not -path '*/nodes/*' | sort))"
  [ "$(cat install/.compiled 2>/dev/null)" = "$wanted" ] && return
  echo 'setup: compiling the kernels'
  set +u; source setup.bash; set -u
  python -m piezo_kernels
  echo "$wanted" >install/.compiled
}

install
build
compile_kernels
