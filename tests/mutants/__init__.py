"""`make mutants`: small wrong changes to the package, each of which some test has to notice."""
