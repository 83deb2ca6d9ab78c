"""The default patch solver, compiled: portable C with the steps and names of the modules in `fitting`."""
