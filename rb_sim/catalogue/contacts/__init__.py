"""What a scene may say of bodies that touch and may part."""
