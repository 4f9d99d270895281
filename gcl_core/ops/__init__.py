"""Operations on points and voxels, each with its derivative where training needs one."""
