"""Problems with answers known from elsewhere, and the page docs/verification.md made from them."""
