#!/usr/bin/env bash
# Makes the workspace usable: tools checked, .venv filled, interfaces and nodes built, kernels
# compiled. `setup.sh dev` installs what tests and lint need besides; `setup.sh demo` compiles only
# the kernels of the demo. Called by the Makefile; a second call finds everything done and returns
# at once.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
unset PYTHONDONTWRITEBYTECODE  # else each process compiles every module that it imports

fail() { echo "setup: $*" >&2; exit 1; }
stage() { echo "setup $*"; }
stamp_of() { cat "$@" | cksum | cut -d' ' -f1; }

find_python() {
  local candidate
  for candidate in ${PYTHON:-} python3 python3.12 python3.11; do
    if "$candidate" -c 'import sys; sys.exit(sys.version_info[:2] not in ((3, 11), (3, 12)))' \
        2>/dev/null; then
      # Not the one of a sourced .venv, which is about to be made anew.
      "$candidate" -c 'import sys; print(sys._base_executable)'
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

# --- .venv -----------------------------------------------------------------------------------------

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
  .venv/bin/python tools/install_wheels.py \
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

install() {
  local wanted begun=$SECONDS
  wanted="${ROS_DISTRO:-wheels} $(stamp_of requirements.txt requirements-ros.txt \
    constraints-ros.txt tools/repair_wheels.py)"
  [ "$(cat .venv/.ready 2>/dev/null)" = "$wanted" ] && return
  check_tools
  stage '1/2: packages into .venv (once; 200 MB to load, 590 MB there)'
  rm -rf .venv build install log
  if [ "${ROS_DISTRO:-}" = jazzy ]; then install_with_ros; else install_with_wheels; fi
  echo "$wanted" >.venv/.ready
  echo "  in $((SECONDS - begun)) s"
}

install_for_developers() {
  local wanted
  wanted=$(stamp_of requirements-dev.txt .venv/.ready)
  [ "$(cat .venv/.ready-dev 2>/dev/null)" = "$wanted" ] && return
  stage 'dev: packages for tests and lint (once)'
  .venv/bin/python tools/install_wheels.py -r requirements-dev.txt \
    $([ -f .venv/local_setup.bash ] && echo -c constraints-ros.txt)
  echo "$wanted" >.venv/.ready-dev
}

# --- the workspace ---------------------------------------------------------------------------------

build_stamp() {  # what is not a symbolic link in the install space; Python sources are linked
  stamp_of $(find src config -type f \( -path 'src/piezo_interfaces/*' -o -path 'config/*' \
    -o -name 'setup.*' -o -name registry.py -o -name package.xml -o -path '*/launch/*' \) -not -name '*.pyc' | sort)
  { find config -type f; find src -path "*/launch/*" -not -path '*/__pycache__*' -o -name __init__.py; } |
    sort | cksum
}

kernel_stamp() {  # machine code is for one kind of processor
  grep -m 2 -E '^(model name|flags)' /proc/cpuinfo | cksum
  stamp_of tools/compile_kernels.py $(find src/piezo_sim src/piezo_hysteresis -name '*.py' \
    -not -path '*/nodes/*' | sort)
}

build() {
  local together=OFF
  if [ -f .venv/local_setup.bash ]; then
    set +u; source .venv/local_setup.bash; set -u
    together=ON  # the generators are those that it was tried with
  fi
  # A library that holds what was generated of a message that is gone does not load.
  local messages; messages=$(find src/piezo_interfaces -type f | sort | cksum)
  [ "$(cat build/.messages 2>/dev/null)" = "$messages" ] ||
    rm -rf build/piezo_interfaces build/trees install/piezo_interfaces
  # Generated code is not ours to mend: its thousands of warnings only cost time.
  # Without -j make looks at the load of the machine, and goes one by one beside busy neighbours.
  PIEZO_TREES="$PWD/build/trees" MAKEFLAGS="${MAKEFLAGS:--j$(nproc)}" .venv/bin/python -m colcon build --symlink-install \
    --event-handlers console_direct- --base-paths src --cmake-args \
    -DPython3_EXECUTABLE="$PWD/.venv/bin/python" -DBUILD_TESTING=OFF -DPIEZO_TOGETHER=$together \
    -DCMAKE_C_FLAGS=-w -DCMAKE_CXX_FLAGS=-w \
    >log/build.txt 2>&1 || { tail -n 40 log/build.txt >&2
    fail 'the build failed; the whole output is in log/build.txt'; }
  echo "$messages" >build/.messages
  build_stamp >install/.built
}

compile_kernels() {  # from the sources, so that the build need not be awaited
  PYTHONPATH="src/piezo_sim:src/piezo_hysteresis${PYTHONPATH:+:$PYTHONPATH}" \
    .venv/bin/python tools/compile_kernels.py $1
  .venv/bin/python -m compileall -q -j 0 src  # the bytecode of what the first command imports
  kernel_stamp >"install/.compiled${1:+-for-demo}"
}

are_compiled() {
  local kernels=$1 file
  for file in install/.compiled ${kernels:+install/.compiled-for-demo}; do
    [ "$(cat "$file" 2>/dev/null)" = "$(kernel_stamp)" ] && return
  done
  return 1
}

make_workspace() {
  local kernels=$1 begun=$SECONDS builds='' compiles='' words=()
  [ "$(cat install/.built 2>/dev/null)" = "$(build_stamp)" ] || words+=('building the workspace')
  [ "${#words[@]}" = 0 ] || builds=yes
  if ! are_compiled "$kernels"; then
    compiles=yes
    words+=("compiling the kernels${kernels:+ of the demo; make setup compiles the others}")
  fi
  [ "${#words[@]}" = 0 ] && return
  stage "2/2: ${words[0]}${words[1]:+ and ${words[1]}}"
  mkdir -p log install
  if [ -n "$builds" ]; then build & fi
  local building=${builds:+$!}
  if [ -n "$compiles" ]; then
    compile_kernels "$kernels" || echo 'setup: kernels are compiled when they are first used instead' >&2
  fi
  if [ -n "$building" ]; then wait "$building" || exit 1; fi
  echo "  in $((SECONDS - begun)) s"
}

# Two at a time would be in each other's way.
exec 9<tools/setup.sh
! command -v flock >/dev/null || flock -n 9 || { echo 'setup: waits for another one'; flock 9; }
install
if [ "${1:-}" = dev ]; then install_for_developers; fi
if [ "${1:-}" = demo ]; then make_workspace 'plant fit demo'; else make_workspace ''; fi
