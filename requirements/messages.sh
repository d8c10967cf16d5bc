#!/bin/sh
# Builds the packages of messages in test/support/messages, as a workspace does, against the wheels in
# .venv, for tests over DDS: build/messages/install, and another version of one, build/messages/older.
set -eu
if [ -n "${AMENT_PREFIX_PATH:-}" ]; then
    echo 'A ROS 2 is sourced, and this builds against wheels only; tests of other messages skip.' >&2
    exit 1
fi
if ! command -v cmake > /dev/null || ! command -v ninja > /dev/null || ! command -v c++ > /dev/null; then
    echo 'cmake, ninja and a C++ compiler are needed; without them tests of other messages skip.' >&2
    exit 1
fi
here=$(cd "$(dirname "$0")" && pwd)
tools=$PWD/build/messages venv=$PWD/.venv
sh "$here/overlay.sh" messages
export AMENT_PREFIX_PATH="$tools:$venv" CMAKE_PREFIX_PATH="$tools:$venv"
export LD_LIBRARY_PATH="$venv/lib" PATH="$tools/bin:$PATH"

# Builds a folder of messages as the package NAME into a prefix.
build() {
    source=$tools/src/$1 name=$2 prefix=$tools/$3
    mkdir -p "$source/msg"
    cp "$here/../test/support/messages/$1"/*.msg "$source/msg"
    cp "$here/../test/support/messages/CMakeLists.txt" "$source"
    sed "s/NAME/$name/" "$here/../test/support/messages/package.xml" > "$source/package.xml"
    cmake -G Ninja -S "$source" -B "$source/build" -DNAME="$name" -DBUILD_TESTING=OFF \
        -DPython3_EXECUTABLE="$tools/bin/python" -DCMAKE_INSTALL_PREFIX="$prefix" \
        -DCMAKE_INSTALL_RPATH='$ORIGIN;$ORIGIN/../../..' > "$source/log"
    cmake --build "$source/build" --target install >> "$source/log"
}

build tf2_msgs tf2_msgs install
build flange_msgs flange_msgs install
build flange_msgs_older flange_msgs older
