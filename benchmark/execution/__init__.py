"""Plans, executes and stores runs."""
