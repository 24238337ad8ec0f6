"""Image types: `registry` has them by letter, `protocol` says what the rest of the package asks of one."""
