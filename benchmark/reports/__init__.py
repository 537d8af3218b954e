"""Reports: the tables and figures of an experiment."""
