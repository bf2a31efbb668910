# find_package(Keygraph): the targets Keygraph::keygraph, the static library, and where there is one
# Keygraph::keygraph_shared. The folder may lie anywhere: put it on CMAKE_PREFIX_PATH.
get_filename_component(_keygraph_prefix "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)

if(NOT TARGET Keygraph::keygraph)
    add_library(Keygraph::keygraph STATIC IMPORTED)
    set_target_properties(Keygraph::keygraph PROPERTIES
        IMPORTED_LOCATION "${_keygraph_prefix}/lib/libkeygraph.a"
        INTERFACE_INCLUDE_DIRECTORIES "${_keygraph_prefix}/include")
endif()

if(EXISTS "${_keygraph_prefix}/lib/libkeygraph.so" AND NOT TARGET Keygraph::keygraph_shared)
    add_library(Keygraph::keygraph_shared SHARED IMPORTED)
    set_target_properties(Keygraph::keygraph_shared PROPERTIES
        IMPORTED_LOCATION "${_keygraph_prefix}/lib/libkeygraph.so"
        INTERFACE_INCLUDE_DIRECTORIES "${_keygraph_prefix}/include")
endif()

unset(_keygraph_prefix)
