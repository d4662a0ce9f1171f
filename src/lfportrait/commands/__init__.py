"""The commands' data classes; `lfportrait.cli` imports the one that is called."""
