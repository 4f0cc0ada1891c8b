"""The `m4` command: one file per command, each thin: parse, call, print."""
