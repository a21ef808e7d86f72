"""Names of the metadata records that the suite writes into a bag."""

ROSBAG2 = 'rosbag2'  # what is in metadata.yaml, as ROS's recorder writes it
METADATA = 'parallel_robot'  # facts of the experiment; prefix of all the others
MESSAGES = 'parallel_robot_messages'  # written and lost messages by topic
PARAMETERS = 'parallel_robot_parameters'  # parameters of a node at the start
CHANGES = 'parallel_robot_changes'  # a later change of parameters
MISSING = {  # why the file of a custom module is not attached, by file
    'custom_laws': 'parallel_robot_missing_laws',
    'custom_robots': 'parallel_robot_missing_robots',
    'custom_trajectories': 'parallel_robot_missing_trajectories',
}
