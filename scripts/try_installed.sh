#!/usr/bin/env bash
# In a workspace that colcon has built: start the installed node as `ros2 run` does, and end it.
set -eo pipefail

. install/setup.bash
export ROS_DOMAIN_ID=${ROS_DOMAIN_ID:-77}
prefix=$(python -c 'from ament_index_python.packages import get_package_prefix as p; print(p("herringbone_sim"))')
for file in launch/simulator.launch.py config/rig.yaml config/plotjuggler.xml config/foxglove.json; do
  test -f "$prefix/share/herringbone_sim/$file"
done

log=$(mktemp)
cd "$(mktemp -d)"
"$prefix/lib/herringbone_sim/simulator" --ros-args \
  --params-file "$prefix/share/herringbone_sim/config/rig.yaml" -p real_time_factor:=0.01 >"$log" 2>&1 &
node=$!
for _ in $(seq 240); do
  if grep -q 'running the' "$log" || ! kill -0 "$node" 2>/dev/null; then break; fi
  sleep 0.5
done
kill -TERM "$node" 2>/dev/null || true
code=0
wait "$node" || code=$?
cat "$log"
grep -q 'running the' "$log"
echo "the installed node ended with exit code $code"
exit "$code"
