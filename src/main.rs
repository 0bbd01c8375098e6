//! The `rebond` command: arguments to calls; nothing else.

fn main() {}
