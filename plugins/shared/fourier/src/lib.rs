//! Fourier transforms of images and volumes on all threads.
