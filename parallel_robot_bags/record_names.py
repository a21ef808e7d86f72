"""Names of the metadata records and attachments that the suite writes into a bag."""

METADATA = 'parallel_robot'  # facts of the experiment; prefix of all the others
MESSAGES = 'parallel_robot_messages'  # written and lost messages by topic
PARAMETERS = 'parallel_robot_parameters'  # parameters of a node at the start
CHANGES = 'parallel_robot_changes'  # a later change of parameters
MISSING_LAWS = 'parallel_robot_missing_laws'  # why a custom law is not attached, by its file
LAWS = 'custom_laws/'  # prefix of attachments: source of a custom law
OLD_LAWS = 'own_laws/'  # the same in older bags
