"""The command `rb_sim`: one verb per module, each imported when it is called."""
