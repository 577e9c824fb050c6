//! Riemannian motion policies: fields, task maps, leaves and the tree, evaluated without allocation.
