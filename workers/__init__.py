"""From a job to its outcome, on any machine: messages in, messages out, no database."""
