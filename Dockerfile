# SPDX-License-Identifier: Apache-2.0
# ROS 2 Jazzy with the driver built by colcon:
#   docker build -t epson_driver . && docker run --rm --network host epson_driver ros2 run epson_driver client
FROM ros:jazzy-ros-base
RUN apt-get update && apt-get install --yes --no-install-recommends python3-pip \
    && pip install --break-system-packages --no-cache-dir ruckig \
    && rm -rf /var/lib/apt/lists/*
COPY . /ws/src/epson_driver
WORKDIR /ws
RUN apt-get update && rosdep update --rosdistro jazzy \
    && rosdep install --from-paths src/epson_driver src/epson_driver/interfaces --ignore-src --yes \
    && rm -rf /var/lib/apt/lists/*
RUN . /opt/ros/jazzy/setup.sh && colcon build --base-paths src/epson_driver src/epson_driver/interfaces
RUN sed -i '/^exec/i . /ws/install/setup.bash' /ros_entrypoint.sh
CMD ["ros2", "run", "epson_driver", "sim_controller"]
