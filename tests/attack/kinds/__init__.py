"""One module for each group of kinds of wrong inputs."""
