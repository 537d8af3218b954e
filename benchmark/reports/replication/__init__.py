"""The replication of the paper."""
