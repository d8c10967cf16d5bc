"""
Bags of rosbag2: whoever reads or writes the files, what is in them is found here.

Read ``bag`` first: it opens and writes by ``rosbags_backend`` where the package rosbags is
installed, and else by ``rosbag2_backend``, a system ROS's rosbag2_py. What messages mean is for
``bag_recording``; what topics may be good for, for ``survey``.
"""
