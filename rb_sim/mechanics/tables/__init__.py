"""The laws of many bodies as programs: per-kind laws over tables and a sparse block elimination."""
