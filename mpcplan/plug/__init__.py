"""Classes that are not ours, named in the configuration or on the command line."""
