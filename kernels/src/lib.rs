//! Queues, batch kernels and physics of the wavepath path tracer.
#![deny(missing_docs)]
