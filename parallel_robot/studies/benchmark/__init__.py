"""A fixed protocol by which laws are judged against the limit, and their scores."""
