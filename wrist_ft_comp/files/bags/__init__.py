"""
Bags of rosbag2: whoever reads or writes the files, what is in them is found here.

Read ``adapter`` first (``open_bag``, ``write_bag``): it hands out a ``bag.Bag``, which
``rosbags_backend`` reads where the package rosbags is installed, and else ``rosbag2_backend`` by
a system ROS's rosbag2_py. What the messages mean is for ``bag_recording``; what topics may be good
for, for ``survey``.
"""
