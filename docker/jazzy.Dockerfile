# GCL-ROS in a workspace of ROS 2 Jazzy, as docs/install.md sets it up.  x86-64, CPU only.
# Not tried: there was no Docker engine where it was written.
#   docker build -f docker/jazzy.Dockerfile -t gcl_ros:jazzy .
#   docker run --rm --net host --ipc host gcl_ros:jazzy ros2 run gcl_ros registrar --ros-args -r source/points:=/b/points
FROM ros:jazzy-ros-base
WORKDIR /workspace
COPY . src/gcl_ros

RUN apt-get update && sh src/gcl_ros/.ci/debian-packages \
 && rosdep update && rosdep install -y --from-paths src --ignore-src \
 && apt-get install -y --no-install-recommends g++ python3-venv \
 && rm -rf /var/lib/apt/lists/*

# The environment that sees ROS; the CPU build of torch first, which pip then keeps.
RUN python3 -m venv --system-site-packages /opt/gcl
ENV PATH=/opt/gcl/bin:$PATH
RUN pip install --no-cache-dir -c src/gcl_ros/constraints.txt --index-url https://download.pytorch.org/whl/cpu torch
RUN pip install --no-cache-dir -c src/gcl_ros/constraints.txt torch numpy scipy matplotlib open3d-cpu small_gicp safetensors \
  pyyaml jaxtyping tqdm rosbags

RUN . /opt/ros/jazzy/setup.sh && python3 -m colcon build
# The kernels for every instruction set, as a wheel has them: the image may run on another processor.
RUN . install/setup.sh && python3 -c "import platform; from gcl_core.ops.native import build; \
build.ship('c++', platform.machine(), build.SHIPPED)"

ENV FASTRTPS_DEFAULT_PROFILES_FILE=/workspace/install/gcl_ros/share/gcl_ros/config/fastdds.xml
ENTRYPOINT ["bash", "-c", ". /workspace/install/setup.bash && exec \"$@\"", "--"]
CMD ["ros2", "run", "gcl_ros", "registrar"]
