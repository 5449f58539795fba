"""rb_sim beside other programs: six scenes, error against CPU time. See ../README.md."""
