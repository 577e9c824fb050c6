//! The policy of the thesis: fields on products of Gaussians seen from the frames.

pub mod gaussian_field;
pub mod gaussian_product;
pub mod product_quad;
pub mod product_skill;
