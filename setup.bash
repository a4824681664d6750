# source setup.bash: makes the built workspace usable, with a sourced ROS 2 Jazzy or with the
# wheels in .venv. Then `ros2 run piezo_hysteresis ...` (where ros2 is installed) or
# `python -m piezo_hysteresis VERB`.
_root="$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)"
if [ ! -f "$_root/install/setup.bash" ]; then
  echo 'setup.bash: the workspace is not built yet: run "make setup" first' >&2
  unset _root
  return 1
fi
source "$_root/.venv/bin/activate"
[ -f "$_root/.venv/local_setup.bash" ] && source "$_root/.venv/local_setup.bash"
source "$_root/install/setup.bash"
# Nodes find each other within a fraction of a second; a file of your own stays in force.
_profiles="$_root/src/piezo_hysteresis/piezo_hysteresis/ros/fastdds.xml"
export FASTRTPS_DEFAULT_PROFILES_FILE="${FASTRTPS_DEFAULT_PROFILES_FILE:-$_profiles}"
unset _profiles
# One short word for the verbs, `piezo`; `source <(piezo completion bash)` completes them.
case ":$PATH:" in *":$_root/bin:"*) ;; *) export PATH="$_root/bin:$PATH" ;; esac
export PIEZO_SOURCED="$_root"
unset _root
